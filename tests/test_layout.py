"""How the package is laid out, what `import jaxslam` gives, and what it does not load."""

import collections
import pydoc
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import jaxslam

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "jaxslam"
# Every other name belongs to one module. `base` is the abstract class of a package.
NAMES_OF_SEVERAL_MODULES = {
    # A command, and the work that it starts.
    "fuse": {"cli", "fusion"},
    "localize": {"cli", "pipeline"},
    "run": {"cli", "pipeline"},
    # What is set, and what is made of it.
    "fusion": {"config", "pipeline"},
    "ranges": {"io", "preprocess"},
    # What is read, and how it is judged.
    "relations": {"io", "metrics"},
    "summary": {"io", "metrics"},
    "trajectory": {"core", "metrics"},
    # One kind of thing in two packages.
    "gaussian": {"motion", "proposal"},
    "reader": {"io", "io/bag", "io/carmen"},
}


def packages() -> set[str]:
    return {path.parent.name for path in PACKAGE.glob("*/__init__.py")}


def loaded_by(code: str, *modules: str) -> list[str]:
    """Run a program of one's own; return which of the modules it has imported at its end."""
    program = f"import sys\n{code}\nprint(*[name for name in {modules} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return done.stdout.splitlines()[-1].split()


def test_no_module_lies_beside_the_packages():
    assert [path.name for path in PACKAGE.glob("*.py")] == ["__init__.py"]


def test_modules_of_one_name_are_known():
    places = collections.defaultdict(set)
    for path in PACKAGE.rglob("*.py"):
        places[path.stem].add(path.parent.relative_to(PACKAGE).as_posix())
    del places["__init__"], places["base"]
    assert {name: where for name, where in places.items() if len(where) > 1} == NAMES_OF_SEVERAL_MODULES


def test_every_package_has_tests():
    assert packages() - {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")} == set()


def test_the_contract_on_imports_names_every_package():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    (contract,) = (each for each in settings["contracts"] if each["type"] == "layers")
    assert contract["exhaustive"]
    assert set(contract["layers"]) == packages()


def test_importing_loads_the_core_only():
    heavy = ("jax", "equinox", "numpy", "matplotlib", "rosbags", "tyro", "PIL", "tqdm", "scipy")
    assert loaded_by("import jaxslam", *heavy) == []
    assert loaded_by("import jaxslam; jaxslam.RBPF", *heavy) == ["jax", "equinox", "numpy"]


@pytest.mark.parametrize(
    "arguments", [("--help",), ("run", "--help"), ("info", "drive.clf"), ("fetch",)], ids=" ".join
)
def test_what_computes_nothing_does_not_import_jax(arguments, tmp_path):
    log = tmp_path / "drive.clf"
    places = [f"{x} 0 0" for x in (0.0, 0.1)]
    log.write_text("".join(f"FLASER 3 1 2 1 {at} {at} {i}.0 h {i}.0\n" for i, at in enumerate(places)))
    arguments = [str(log) if argument == log.name else argument for argument in arguments]
    code = f"from jaxslam.cli.main import main\nassert main({arguments}) == 0"
    heavy = ("jax", "equinox", "matplotlib", "scipy", "optuna", "rosbags", "tqdm")
    assert loaded_by(code, *heavy) == []


def test_the_list_of_commands_needs_no_parser():
    code = "from jaxslam.cli.main import main\nassert main(['--help']) == 0"
    assert loaded_by(code, "tyro", "numpy", "dataclasses") == []


def test_a_download_needs_no_jax():
    assert loaded_by("import jaxslam.io.download", "jax", "equinox") == []


def test_help_needs_no_extra():
    extras = ("matplotlib", "optuna", "tyro", "tqdm", "tomlkit", "PIL", "rosbags", "optax", "skimage")
    # An entry of None makes the import of a module fail.
    blocked = f"import sys\nsys.modules.update(dict.fromkeys({extras}))"
    program = f"{blocked}\nimport pydoc, jaxslam\nprint(pydoc.render_doc(jaxslam))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )
    shown = pydoc.plain(done.stdout)
    assert [name for name in jaxslam.__all__ if name not in shown] == ["__version__"]
    assert "VERSION" in shown


def test_every_public_name_is_there():
    packages = [getattr(jaxslam, name) for name in (*jaxslam.__all__, "study", "viz")]
    packages = [jaxslam, *(p for p in packages if getattr(p, "__all__", None))]
    assert len(packages) > 5
    for package in packages:
        assert list(package.__all__) == sorted(set(package.__all__), key=package.__all__.index)
        for name in package.__all__:
            assert hasattr(package, name)


def test_dir_lists_the_public_names():
    assert dir(jaxslam) == sorted(jaxslam.__all__)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'jaxslam' has no attribute 'rbpf'"):
        jaxslam.rbpf  # noqa: B018
