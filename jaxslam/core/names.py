"""Errors for misspelled names and for missing extras. This module imports no JAX."""

import contextlib
import difflib
from collections.abc import Collection, Iterator

_EXTRAS = {
    "cli": ("tyro", "matplotlib", "PIL", "rosbags", "ruamel", "tqdm", "tomlkit", "docstring_parser", "pooch"),
    "train": ("lineax", "optax", "optimistix"),
    "vision": ("skimage",),
    "study": ("optuna", "sqlalchemy", "cmaes", "sklearn"),
    "cluster": ("dask", "distributed"),
}
"""Modules that jaxslam needs in addition to its core, by the extra that installs them."""


def did_you_mean(name: str, known: Collection[str]) -> str:
    """Return "did you mean 'NAME'? " with the most similar known name; empty if none is similar."""
    nearest = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {nearest[0]!r}? " if nearest else ""


def check_names(context: str, known: Collection[str], *names: object) -> None:
    """Raise `ValueError` for an unknown name: "CONTEXT 'NAME': did you mean 'NEAR'? There are NEAR, FAR"."""
    for name in names:
        if name not in known:
            hint = did_you_mean(str(name), known)
            raise ValueError(f"{context} {name!r}: {hint}There are {', '.join(known)}")


class MissingExtraError(ModuleNotFoundError):
    """A missing optional dependency. The message is one line with the command that installs it."""


@contextlib.contextmanager
def optional_import() -> Iterator[None]:
    """Replace the error of a missing optional dependency by a `MissingExtraError`."""
    try:
        yield
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        extra = next((name for name, modules in _EXTRAS.items() if missing in modules), None)
        if extra is None:
            raise
        raise MissingExtraError(f"{missing} is not installed: pip install 'jaxslam[{extra}]'") from None
