"""Checksums of logs, versions and memory, as a run records them."""

import hashlib

import jax

from jaxslam.report import file_sha256, peak_rss_mb, versions


def test_checksum_of_a_file(tmp_path):
    # Longer than the block in which files are read.
    content = bytes(range(256)) * 5000
    (tmp_path / "log").write_bytes(content)
    assert file_sha256(tmp_path / "log") == hashlib.sha256(content).hexdigest()


def test_checksum_of_a_folder_sees_names_and_contents(tmp_path):
    def checksum(folder, **files):
        (tmp_path / folder / "sub").mkdir(parents=True)
        for name, content in files.items():
            (tmp_path / folder / "sub" / name).write_text(content)
        return file_sha256(tmp_path / folder)

    first = checksum("first", a="1", b="2")
    assert checksum("second", b="2", a="1") == first
    others = {checksum("third", a="1", b="3"), checksum("fourth", a="1", c="2"), checksum("fifth", a="1")}
    assert len(others | {first}) == 4


def test_versions_are_those_installed():
    assert versions()["jax"] == jax.__version__
    assert {"jaxslam", "numpy", "python", "platform"} <= versions().keys()


def test_peak_memory_is_in_megabytes():
    # More than JAX alone takes up, and less than any machine that runs the tests has.
    assert 100 < peak_rss_mb() < 100_000
