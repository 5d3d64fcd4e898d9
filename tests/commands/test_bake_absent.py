"""`lensfield lens bake` where what it needs is not installed."""

import builtins
import sys

import pytest

from lensfield import cli

BAKE = "lensfield.engine.bake"


@pytest.fixture
def without(monkeypatch):
    """Take modules, and all of the engine that needs them, out of reach."""
    def take_out(*modules):
        for name in list(sys.modules):
            if name.split(".")[0] in modules or f"{name}.".startswith(f"{BAKE}."):
                monkeypatch.delitem(sys.modules, name)
        find = builtins.__import__

        def without_them(name, *arguments, **keywords):
            if name.split(".")[0] in modules:
                raise ModuleNotFoundError(f"No module named {name.split('.')[0]!r}", name=name.split(".")[0])
            return find(name, *arguments, **keywords)

        monkeypatch.setattr(builtins, "__import__", without_them)

    return take_out


def test_one_line_says_what_is_missing_and_how_to_get_it(without, tmp_path, capsys):
    without("optiland", "finufft")
    (tmp_path / "lens.toml").write_text("")
    assert cli.main(["lens", "bake", str(tmp_path / "lens.toml"), "-o", str(tmp_path / "lens.npz")]) == 1
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("lensfield: bake: module is optiland: not there: ")
    assert "`make bake`" in err and "pip install 'lensfield[bake]'" in err
    assert [path.name for path in tmp_path.iterdir()] == ["lens.toml"]


def test_the_other_commands_need_none_of_it(without, capsys):
    without("optiland", "finufft")
    assert cli.main(["lens", "info", "edmund-54852"]) == 0 and "focal length" in capsys.readouterr().out
    assert cli.main(["lens", "bake", "--help"]) == 0 and "--object-distance" in capsys.readouterr().out
