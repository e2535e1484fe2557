"""The STAC item of a prediction is one."""

import json

import elunardtm

from pystac import Item, STACObjectType
from pystac.validation.stac_validator import JsonSchemaSTACValidator


def test_the_item_is_valid(tmp_path, scene):
    image, coarse, _ = scene.write(tmp_path)
    item = tmp_path / "item.json"
    made = elunardtm.Model.load("nano").predict_file(
        image, coarse, tmp_path / "dtm.tif", stac=item, time="2009-08-30T12:00:00", progress=False
    )
    found = json.loads(item.read_text())
    # The core's schema is in the package; those of the extensions are on the net.
    assert JsonSchemaSTACValidator().validate_core(found, STACObjectType.ITEM, found["stac_version"])
    opened = Item.from_file(item)
    assert opened.properties["proj:shape"] == [made["rows"], made["cols"]]
    assert {name: asset.roles for name, asset in opened.assets.items()} == {"dtm": ["data"], "hillshade": ["overview"]}
