"""Networks on disk: what comes back, and what is told of files that are none."""

import io
import json
import pickle

import chex
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.range_network import RangeNetwork, load_network, save_network

NUM_NEURONS = 6


@pytest.fixture
def path(tmp_path):
    """A good file; the tests damage it."""
    path = tmp_path / "lds.eqx"
    save_network(path, drawn())
    return path


def drawn(num_neurons=NUM_NEURONS) -> RangeNetwork:
    return RangeNetwork.draw(jax.random.key(7), num_neurons, 0.12, 3.5)


def refusal(path) -> str:
    """What a file is refused with: one line that names it."""
    with pytest.raises(ValueError, match=r"lds\.eqx: ") as error:
        load_network(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("num_neurons", [1, 50])
def test_a_network_comes_back_as_it_was(tmp_path, num_neurons):
    network = drawn(num_neurons)
    save_network(tmp_path / "n.eqx", network)
    loaded = load_network(tmp_path / "n.eqx")
    chex.assert_trees_all_equal(loaded, network, strict=True)


def test_the_same_network_makes_the_same_bytes(path, tmp_path):
    save_network(tmp_path / "again.eqx", load_network(path))
    assert (tmp_path / "again.eqx").read_bytes() == path.read_bytes()


def test_its_first_line_says_what_it_is(path):
    header = json.loads(path.read_bytes().partition(b"\n")[0])
    assert header == {"format": "jaxslam range network", "version": 1, "neurons": NUM_NEURONS}


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"true_m,measured_m\n1.0,1.02\n",
        pickle.dumps({"weights_in": [1.0]}),
        b"12\n",
        b"null\n",
        b"[" * 9 + b"\n",
        b'{"format": "something else", "version": 1, "neurons": 6}\n',
        b"\xff\xfe\x00\n",
        b"\x93NUMPY\x01\x00",
    ],
    ids=["empty", "csv", "pickle", "number", "null", "brackets", "other format", "binary", "npy"],
)
def test_what_is_no_network(path, content):
    path.write_bytes(content)
    assert "not a range network; `jaxslam train-range` writes one" in refusal(path)


def with_header(path, **changes):
    first, _, rest = path.read_bytes().partition(b"\n")
    path.write_bytes(json.dumps({**json.loads(first), **changes}).encode() + b"\n" + rest)


@pytest.mark.parametrize("version", [0, 2, "1", None])
def test_another_version(path, version):
    with_header(path, version=version)
    message = refusal(path)
    assert f"of version {version}, but this release reads version 1: train it again" in message


@pytest.mark.parametrize("neurons", [5, 7, 1, 100_000])
def test_a_header_of_another_size(path, neurons):
    with_header(path, neurons=neurons)
    assert f"damaged, or not of {neurons} neurons as stated in its header" in refusal(path)


@pytest.mark.parametrize("neurons", [0, -6, 6.0, "6", None, 10**9])
def test_a_header_of_no_size(path, neurons):
    with_header(path, neurons=neurons)
    assert f"number of neurons in the header is {neurons!r}: the file is damaged" in refusal(path)


def test_a_truncated_file(path):
    whole = path.read_bytes()
    start = whole.index(b"\n") + 1
    for length in (start - 1, start, start + 3, start + 60, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        assert f"damaged, or not of {NUM_NEURONS} neurons as stated in its header (" in refusal(path)
    path.write_bytes(whole[: start // 2])
    assert "not a range network" in refusal(path)


@pytest.mark.parametrize("extra", [b"\x00", b"\n", b"more"])
def test_bytes_after_the_end(path, extra):
    path.write_bytes(path.read_bytes() + extra)
    assert f"longer than the {NUM_NEURONS} neurons of its header" in refusal(path)


def test_a_damaged_byte_is_told_or_changes_a_number(path):
    """In the first array's own header and its numbers."""
    whole, start = path.read_bytes(), path.read_bytes().index(b"\n") + 1
    messages = []
    for position in range(start, start + 140):
        path.write_bytes(whole[:position] + bytes([whole[position] ^ 0x10]) + whole[position + 1 :])
        try:
            assert load_network(path).num_neurons == NUM_NEURONS
        except ValueError as error:
            messages.append(str(error))
    assert len(messages) > 50
    assert all(message.startswith(f"{path}: ") and "\n" not in message for message in messages)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("leaf", ["weights_out", "bias_out", "longest"])
def test_numbers_that_are_not_finite(path, leaf, value):
    network = drawn()
    spoilt = eqx.tree_at(
        lambda n: getattr(n, leaf), network, replace_fn=lambda old: jnp.full_like(old, value, old.dtype)
    )
    save_network(path, spoilt)
    assert "a parameter is not finite: train the network again" in refusal(path)


class Trap:
    """Leaves a mark when it is unpickled."""

    sprung = False

    @staticmethod
    def spring():
        Trap.sprung = True

    def __reduce__(self):
        return Trap.spring, ()


def test_no_pickle_is_loaded(path):
    trapped = pickle.dumps(Trap())
    pickle.loads(trapped)
    assert Trap.sprung, "the trap must work"
    Trap.sprung = False
    first, _, rest = path.read_bytes().partition(b"\n")
    objects = io.BytesIO()
    np.save(objects, np.array([Trap()] * NUM_NEURONS, object), allow_pickle=True)
    for content in (
        trapped,
        first + b"\n" + trapped,
        first + b"\n" + objects.getvalue() + rest,
        objects.getvalue(),
    ):
        path.write_bytes(content)
        refusal(path)
    assert not Trap.sprung


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(FileNotFoundError):
        load_network(tmp_path / "missing.eqx")
