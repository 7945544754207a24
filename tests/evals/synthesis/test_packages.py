"""Packages of every form."""

import pytest

from evals.synthesis.packages import FORMS, build_package
from scripts.assets.grocery_table import GROCERIES


def test_there_are_28_kinds_with_their_own_names() -> None:
    assert len({grocery.kind for grocery in GROCERIES}) == len(GROCERIES) == 28
    assert {grocery.form for grocery in GROCERIES} == set(FORMS)


@pytest.mark.parametrize("form", FORMS)
def test_each_form_builds_the_same_asset_twice(form: str) -> None:
    grocery = next(grocery for grocery in GROCERIES if grocery.form == form)
    first, second = build_package(grocery), build_package(grocery)
    assert (first.asset, first.urdf, first.meshes) == (second.asset, second.urdf, second.meshes)
    assert all((first.textures[name] == second.textures[name]).all() for name in first.textures)
    assert grocery.kind in first.asset.name
    assert first.asset.size == grocery.size
