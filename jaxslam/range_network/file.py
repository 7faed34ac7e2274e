"""Network files: one line of JSON and the parameters, without pickle."""

import io
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxslam.range_network.network import RangeNetwork

_FORMAT, _VERSION = "jaxslam range network", 1
_MAX_NEURONS = 100_000


def save_network(path: Path, network: RangeNetwork) -> None:
    """Write a network, to be loaded with `load_network`."""
    header = {"format": _FORMAT, "version": _VERSION, "neurons": network.num_neurons}
    with path.open("wb") as stream:
        stream.write(json.dumps(header).encode("ascii") + b"\n")
        eqx.tree_serialise_leaves(stream, network)


def load_network(path: Path) -> RangeNetwork:
    """Read a network.

    Raises:
        ValueError: the file is not a network, is of another version, or is damaged.
        OSError: the file cannot be read.
    """
    content = path.read_bytes()
    first, _, rest = content.partition(b"\n")
    try:
        header = json.loads(first)
        known = isinstance(header, dict) and header.get("format") == _FORMAT
    except ValueError:
        known = False
    if not known:
        raise ValueError(f"{path}: not a range network; `jaxslam train-range` writes one")
    if header.get("version") != _VERSION:
        raise ValueError(
            f"{path}: range network of version {header.get('version')}, but this release reads version "
            f"{_VERSION}: train it again with `jaxslam train-range`"
        )
    count = header.get("neurons")
    if not (isinstance(count, int) and 1 <= count <= _MAX_NEURONS):
        raise ValueError(f"{path}: number of neurons in the header is {count!r}: the file is damaged")
    blank = jax.eval_shape(lambda: RangeNetwork.draw(jax.random.key(0), count, 0.0, 1.0))
    blank = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), blank)
    stream = io.BytesIO(rest)
    try:
        network = eqx.tree_deserialise_leaves(stream, blank)
    except (RuntimeError, ValueError, EOFError, OSError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(
            f"{path}: damaged, or not of {count} neurons as stated in its header ({reason})"
        ) from error
    if stream.read(1):
        raise ValueError(f"{path}: longer than the {count} neurons of its header: the file is damaged")
    if not all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(network)):
        raise ValueError(f"{path}: a parameter is not finite: train the network again")
    return network
