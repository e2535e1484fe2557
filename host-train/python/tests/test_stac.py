"""The STAC item of a prediction is one."""

import json

import elunardtm

from pystac import Item
from pystac.validation.local_validator import LocalValidator


def test_the_item_is_valid(tmp_path, scene):
    image, coarse, _ = scene.write(tmp_path)
    item = tmp_path / "item.json"
    made = elunardtm.Model.load("nano").predict_file(
        image, coarse, tmp_path / "dtm.tif", stac=item, time="2009-08-30T12:00:00", progress=False
    )
    found = json.loads(item.read_text())
    assert not list(LocalValidator().item_validator(found["stac_version"]).iter_errors(found))
    opened = Item.from_file(item)
    assert opened.properties["proj:shape"] == [made["rows"], made["cols"]]
    assert {name: asset.roles for name, asset in opened.assets.items()} == {"dtm": ["data"], "hillshade": ["overview"]}
