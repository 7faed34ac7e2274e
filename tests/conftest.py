"""Strict settings for every test: shapes checked, no silent promotion, the real logs by fixture."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    # What one test has compiled, the other workers and the commands that tests start need not compile again.
    _programs = tempfile.mkdtemp(prefix="jaxslam-programs-")
    atexit.register(shutil.rmtree, _programs, ignore_errors=True)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = _programs
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.3"

import jax
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
# Two, so that what is spread over devices can be tested; all else stays on the first.
jax.config.update("jax_num_cpu_devices", 2)

# Every annotated function of the library checks its shapes and types while the tests run: the hook stays, so
# that modules which `import jaxslam` does not load (viz, cli, run) are checked as well.
# An int is good for a float, as everywhere in Python's typing (PEP 484, the numeric tower).
install_import_hook("jaxslam", "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))")


def pytest_configure(config: pytest.Config) -> None:
    """Tests compile for longer than they run: they get a rough draft of machine code, benchmarks do not.

    The commands, notebooks and experiments that they start are compiled as for users.
    """
    if config.getoption("benchmark_only"):
        return
    flags = os.environ.get("XLA_FLAGS")
    os.environ["XLA_FLAGS"] = f"{flags or ''} --xla_backend_optimization_level=0"
    # XLA reads its flags once, here; what is started from here on shall not see them.
    jax.devices()
    if flags is None:
        del os.environ["XLA_FLAGS"]
    else:
        os.environ["XLA_FLAGS"] = flags
    # JAX tells programs apart by the flags that it sees: drafts need a folder of their own.
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"] + "/drafts")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real logs; tests that need it skip where it is absent."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("JAXSLAM_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"real logs not found in {folder}: set JAXSLAM_DATA to the folder that has them")
    return folder
