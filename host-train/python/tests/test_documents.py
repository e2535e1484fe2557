"""Every public item has a docstring with an example that runs."""

import doctest
import inspect

import elunardtm


def public():
    for name in elunardtm.__all__:
        item = getattr(elunardtm, name)
        if inspect.isclass(item) and issubclass(item, BaseException):
            continue
        yield name, item
        if inspect.isclass(item):
            for method, member in vars(item).items():
                member = getattr(member, "__func__", member)
                if not method.startswith("_") and (inspect.isfunction(member) or isinstance(member, property)):
                    yield f"{name}.{method}", member


def test_examples_run():
    failed, ran = doctest.testmod(elunardtm)
    assert failed == 0 and ran > 30


def test_every_public_item_has_an_example():
    assert [name for name, item in public() if ">>>" not in (inspect.getdoc(item) or "")] == []


def test_docstrings_name_every_argument():
    # Said of all functions, in the docstring of the package or in the first line.
    common = {"self", "cls", "progress", "transform", "crs", "pixel_size", "coarse_crs", "dtm", "dtms", "first", "second", "truth", "coarse"}
    missing = []
    for name, item in public():
        if inspect.isfunction(item):
            text = inspect.getdoc(item)
            arguments = set(inspect.signature(item).parameters) - common
            if "options are those of" not in text:
                missing += [f"{name}: {argument}" for argument in arguments if argument not in text]
    assert sorted(missing) == []
