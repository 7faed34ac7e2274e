"""Suggestions for misspelt names, and what to install for a missing dependency."""

import subprocess
import sys

import pytest

from jaxslam.core.names import MissingExtraError, check_names, did_you_mean, optional_import

KNOWN = ("sick", "urg-04lx", "vlp-16")


@pytest.mark.parametrize(
    ("name", "hint"), [("sik", "did you mean 'sick'? "), ("vlp16", "did you mean 'vlp-16'? "), ("hokuyo", "")]
)
def test_only_similar_names_are_suggested(name, hint):
    assert did_you_mean(name, KNOWN) == hint


def test_the_first_unknown_name_is_reported():
    check_names("no lidar is called", KNOWN, *KNOWN)
    with pytest.raises(
        ValueError, match=r"^no lidar is called 'sik': did you mean 'sick'\? There are sick, urg"
    ):
        check_names("no lidar is called", KNOWN, "vlp-16", "sik", "hokuyo")
    with pytest.raises(ValueError, match=r"^no lidar is called 4: There are sick, urg-04lx, vlp-16$"):
        check_names("no lidar is called", KNOWN, 4)


def test_an_import_that_no_extra_has_keeps_its_error():
    named = r"^optuna is not installed: pip install 'jaxslam\[study\]'$"
    with pytest.raises(MissingExtraError, match=named), optional_import():
        raise ModuleNotFoundError(name="optuna.samplers")
    with pytest.raises(ModuleNotFoundError, match="No module named 'nowhere'") as raised, optional_import():
        import nowhere  # noqa: F401
    assert raised.type is ModuleNotFoundError


@pytest.mark.parametrize(
    ("missing", "program", "extra"),
    [
        ("matplotlib", "import jaxslam; jaxslam.viz", "cli"),
        ("PIL", "from jaxslam.viz.results import plot_run", "cli"),
        ("optuna", "from jaxslam.study import read_plan", "study"),
        (
            "tomlkit",
            "import jaxslam; from jaxslam.config import toml; toml.dumps(jaxslam.SlamConfig())",
            "cli",
        ),
    ],
)
def test_a_missing_extra_is_named_in_python(missing, program, extra):
    # An entry of None makes the import of a module fail.
    program = f"import sys; sys.modules[{missing!r}] = None; {program}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    name = "jaxslam.core.names.MissingExtraError"
    assert (
        done.stderr.splitlines()[-1] == f"{name}: {missing} is not installed: pip install 'jaxslam[{extra}]'"
    )


def test_names_need_no_jax():
    program = "import sys, jaxslam.core.names; sys.exit('jax' in sys.modules or 'numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", program], check=True)
