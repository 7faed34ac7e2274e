"""Cells that are computed once, and the flags that all experiments share."""

import numpy as np
import pytest

from experiments._harness.harness import (
    Cell,
    Options,
    compute,
    markdown_table,
    parse_options,
    spread_over_seeds,
)


def square(cell):
    return {"value": np.asarray(cell.settings["number"] ** 2), "marks": np.random.default_rng().random(3)}


def cells(*numbers):
    return [Cell(f"n{number}", {"number": number, "nested": {"a": [1.5]}}) for number in numbers]


def options(folder, fresh=False):
    return Options(out=folder, seeds=1, workers=1, smoke=True, fresh=fresh)


def test_what_the_folder_has_is_not_computed_again(tmp_path):
    first = compute(cells(2, 3), square, options(tmp_path))
    assert {name: int(cell["value"]) for name, cell in first.items()} == {"n2": 4, "n3": 9}
    again = compute(cells(2, 3, 4), square, options(tmp_path))
    np.testing.assert_array_equal(again["n2"]["marks"], first["n2"]["marks"])
    assert int(again["n4"]["value"]) == 16
    fresh = compute(cells(2), square, options(tmp_path, fresh=True))
    assert (fresh["n2"]["marks"] != first["n2"]["marks"]).all()


def test_other_settings_under_the_same_name_are_computed(tmp_path):
    compute(cells(2), square, options(tmp_path))
    changed = [Cell("n2", {"number": 5})]
    assert int(compute(changed, square, options(tmp_path))["n2"]["value"]) == 25


def test_a_cell_that_fails_ends_the_run_and_leaves_the_others(tmp_path):
    broken = [*cells(2), Cell("n9", {"number": None})]
    with pytest.raises(TypeError):
        compute(broken, square, options(tmp_path))
    assert (tmp_path / "raw/n2.npz").exists()
    assert not (tmp_path / "raw/n9.npz").exists()


@pytest.mark.parametrize("flags", [["--seeds", "0"], ["--workers", "0"], ["--smoke"], ["--what"]])
def test_flags_that_make_no_sense_are_refused(flags, capsys):
    with pytest.raises(SystemExit):
        parse_options("tobacco_line", "?", 10, flags)
    assert "error" in capsys.readouterr().err


def test_tables_and_spreads_are_written_for_people():
    assert spread_over_seeds(np.array([1.0, 2.0, 3.0]), digits=1) == "2.0 ± 0.8 (3.0)"
    assert markdown_table(["a", "b"], [["1", "2"]]) == "| a | b |\n|---|---|\n| 1 | 2 |\n"
