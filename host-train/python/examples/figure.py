"""Predicts a synthetic scene and draws it: image, coarse DTM, prediction and its expected errors.

    pip install . matplotlib && python host-train/python/examples/figure.py figure.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import elunardtm


def main(path: str) -> None:
    scene = elunardtm.example(256, 320)
    made = elunardtm.Model.load("ground").predict(scene.image, scene.coarse, **scene.place, uncertainty=True)
    # One light for all, so that the three can be compared; the coarse DTM is put on the image's grid by a mosaic of one.
    window = (scene.transform[2], scene.transform[5] - 512, scene.transform[2] + 640, scene.transform[5])
    coarse, _ = elunardtm.mosaic([scene.coarse], transforms=[scene.coarse_transform], tr=2.0, t_projwin=window)
    shades = [elunardtm.hillshade(dtm, transform=scene.transform) for dtm in (coarse, made.heights, scene.truth)]
    panels = zip(("image", "coarse DTM", "prediction", "truth"), (scene.image, *shades))
    figure, axes = plt.subplots(1, 5, figsize=(17, 3.2), layout="constrained")
    for axis, (title, panel) in zip(axes, panels):
        axis.imshow(panel, cmap="gray")
        axis.set_title(title)
    drawn = axes[4].imshow(made.sigma, cmap="viridis")
    axes[4].set_title("expected error")
    figure.colorbar(drawn, ax=axes[4], label="m")
    for axis in axes:
        axis.set_xticks([])
        axis.set_yticks([])
    figure.savefig(path, dpi=110)
    found = elunardtm.evaluate(made.heights, scene.truth, scene.coarse, **scene.place)
    for one in found["candidates"]:
        print(f"{one['name']}: RMSE {one['rmse_m']:.2f} m, slope MAE {one['slope_mae_deg']:.2f} deg")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "figure.png")
