"""Downloads from a server on the loopback address: resumed, verified, kept; and what can go wrong."""

import errno
import hashlib
import http.server
import json
import re
import socket
import threading
from pathlib import Path

import pytest

import jaxslam.io.download as fetch
from jaxslam.io.download import FetchError, cache_folder, fetch_files, fetch_log
from jaxslam.io.public_logs import PUBLIC_LOGS, PublicLog, RemoteFile

CONTENT = bytes(range(256)) * 2000
COMMIT = "a" * 40


def blob_id(content):
    return hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()


class Server:
    """Serves files as the raw host does, and their tree as its API does; keeps the requests.

    `files` maps commit and path to content; `cut` ends the next answer after that many bytes of it.
    """

    def __init__(self):
        self.files = {f"{COMMIT}/data/log.bin": CONTENT}
        self.blobs = {}
        self.requests = []
        self.ranges = True
        self.wrong_range = False
        self.status = None
        self.cut = None
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                outer.answer(self)

            def log_message(self, *args):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def answer(self, request):
        start = request.headers.get("Range")
        self.requests.append((request.path, start))
        if self.status is not None:
            return request.send_error(self.status)
        if request.path.startswith("/tree/"):
            commit = request.path.split("/")[-1]
            entries = [
                {
                    "path": name.partition("/")[2],
                    "type": "blob",
                    "size": len(content),
                    "sha": self.blobs.get(name, blob_id(content)),
                }
                for name, content in self.files.items()
                if name.startswith(commit)
            ]
            tree = [{"path": "data", "type": "tree", "sha": "b" * 40}, *entries]
            return self.send(request, 200, json.dumps({"tree": tree}).encode())
        content = self.files.get(request.path.removeprefix("/raw/owner/name/"))
        if content is None:
            return request.send_error(404)
        if start is None or not self.ranges:
            return self.send(request, 200, content)
        first = int(re.fullmatch(r"bytes=(\d+)-", start)[1])
        if first >= len(content):
            return request.send_error(416)
        first = first + 1 if self.wrong_range else first
        return self.send(request, 206, content[first:], f"bytes {first}-{len(content) - 1}/{len(content)}")

    def send(self, request, status, content, content_range=None):
        request.send_response(status)
        request.send_header("Content-Length", str(len(content)))
        if content_range is not None:
            request.send_header("Content-Range", content_range)
        request.end_headers()
        if "/raw/" in request.path:
            content, self.cut = content[: self.cut], None
        request.wfile.write(content)


@pytest.fixture
def server(monkeypatch):
    server = Server()
    fetch._list_blobs.cache_clear()
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr(fetch, "FILE_URL", server.url + "/raw/{repository}/{commit}/{path}")
    monkeypatch.setattr(fetch, "TREE_URL", server.url + "/tree/{repository}/{commit}")
    yield server
    server.server.shutdown()
    server.server.server_close()


def remote(**changes):
    return RemoteFile(
        **{"repository": "owner/name", "commit": COMMIT, "path": "data/log.bin", "name": "l.bin"} | changes
    )


SHA256 = hashlib.sha256(CONTENT).hexdigest()


def leave_part(folder, content):
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / f"l.bin.{COMMIT[:12]}.part"
    part.write_bytes(content)
    return part


def test_known_checksum_needs_one_request_and_a_second_call_none(server, tmp_path):
    (path,) = fetch_files([remote(sha256=SHA256)], tmp_path)
    assert path.read_bytes() == CONTENT
    assert [name for name, _ in server.requests] == [f"/raw/owner/name/{COMMIT}/data/log.bin"]
    assert fetch_files([remote(sha256=SHA256)], tmp_path) == [path]
    assert len(server.requests) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["l.bin"]


def test_unknown_checksum_is_the_blob_of_the_commit_and_is_remembered(server, tmp_path):
    server.files[f"{COMMIT}/other"] = b"second"
    files = [remote(), remote(path="other", name="o")]
    paths = fetch_files(files, tmp_path)
    assert [path.read_bytes() for path in paths] == [CONTENT, b"second"]
    assert sum(name.startswith("/tree/") for name, _ in server.requests) == 1
    assert f"l.bin {SHA256}\n" in (tmp_path / "checksums.txt").read_text()
    server.requests.clear()
    fetch_files(files, tmp_path)
    assert server.requests == []


def test_a_file_damaged_in_the_cache_is_downloaded_again_by_its_remembered_checksum(server, tmp_path):
    (path,) = fetch_files([remote()], tmp_path)
    path.write_bytes(b"damaged")
    server.requests.clear()
    fetch_files([remote()], tmp_path)
    assert path.read_bytes() == CONTENT
    assert len(server.requests) == 1


def test_blob_of_another_content_is_refused_and_removed(server, tmp_path):
    server.blobs[f"{COMMIT}/data/log.bin"] = blob_id(b"other")
    with pytest.raises(FetchError, match=f"wrong checksum \\({blob_id(CONTENT)}, expected"):
        fetch_files([remote()], tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_wrong_checksum_is_refused_and_removed(server, tmp_path):
    with pytest.raises(FetchError, match="the download was removed; run the command again"):
        fetch_files([remote(sha256="0" * 64)], tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"another version", None])
def test_the_next_commit_is_tried(server, tmp_path, content):
    server.files[f"{COMMIT}/data/log.bin"] = content
    server.files["bbb/data/log.bin"] = CONTENT
    (path,) = fetch_files([remote(sha256=SHA256, other_commits=("bbb",))], tmp_path)
    assert path.read_bytes() == CONTENT


def test_file_that_is_not_in_the_commit(server, tmp_path):
    with pytest.raises(FetchError, match=f"owner/name: no file gone in commit {COMMIT}"):
        fetch_files([remote(path="gone")], tmp_path)


@pytest.mark.parametrize("known", [SHA256, None])
def test_broken_download_continues_from_its_part(server, tmp_path, known):
    file = remote(sha256=known)
    server.cut = 100_000
    with pytest.raises(FetchError, match="broke: run the command again, which continues the download"):
        fetch_files([file], tmp_path)
    part = tmp_path / f"l.bin.{COMMIT[:12]}.part"
    done = part.stat().st_size
    assert 0 < done <= 100_000
    server.requests.clear()
    (path,) = fetch_files([file], tmp_path)
    assert path.read_bytes() == CONTENT
    assert server.requests[-1][1] == f"bytes={done}-"
    assert not part.exists()


@pytest.mark.parametrize("fault", ["ranges", "wrong_range"])
def test_server_that_cannot_continue_starts_anew(server, tmp_path, fault):
    leave_part(tmp_path, b"x" * 1000)
    setattr(server, fault, fault == "wrong_range")
    (path,) = fetch_files([remote(sha256=SHA256)], tmp_path)
    assert path.read_bytes() == CONTENT


def test_part_that_is_too_long_starts_anew(server, tmp_path):
    leave_part(tmp_path, CONTENT + b"more")
    (path,) = fetch_files([remote(sha256=SHA256)], tmp_path)
    assert path.read_bytes() == CONTENT
    assert [start for _, start in server.requests] == [f"bytes={len(CONTENT) + 4}-", None]


def test_whole_part_is_not_requested_again(server, tmp_path):
    leave_part(tmp_path, CONTENT)
    (path,) = fetch_files([remote(sha256=SHA256, size=len(CONTENT))], tmp_path)
    assert path.read_bytes() == CONTENT
    assert server.requests == []


@pytest.mark.parametrize(
    ("status", "message"),
    [
        (404, "HTTP 404 Not Found: the file is no longer there"),
        (403, r"refuses the request \(HTTP 403 Forbidden\): wait an hour"),
        (503, "HTTP 503 Service Unavailable: run the command again later"),
    ],
)
def test_refusals_of_the_server(server, tmp_path, status, message):
    server.status = status
    for known in (SHA256, None):
        with pytest.raises(FetchError, match=message) as raised:
            fetch_files([remote(sha256=known)], tmp_path)
        assert "\n" not in str(raised.value)


def test_answer_that_is_no_json(server, tmp_path, monkeypatch):
    monkeypatch.setattr(fetch, "TREE_URL", f"{server.url}/raw/owner/name/{COMMIT}/data/log.bin")
    with pytest.raises(FetchError, match="not JSON"):
        fetch_files([remote()], tmp_path)


def test_no_network_names_the_host(server, tmp_path, monkeypatch):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        host = f"127.0.0.1:{unused.getsockname()[1]}"
    monkeypatch.setattr(fetch, "FILE_URL", f"http://{host}/{{path}}")
    log = PublicLog("x", "", "", "", (remote(sha256=SHA256),), "copy")
    with pytest.raises(
        FetchError, match=re.escape(f"cannot reach {host} (no connection): check the")
    ) as raised:
        fetch_log(log, tmp_path)
    assert str(raised.value).endswith(f"copy its folder x to {tmp_path / 'x'}")


def test_full_disk_keeps_the_part_for_the_next_run(server, tmp_path, monkeypatch):
    log = PublicLog("x", "", "", "", (remote(sha256=SHA256),), "copy")
    opened = Path.open

    def full(path, mode="r", *args, **kwargs):
        stream = opened(path, mode, *args, **kwargs)
        if path.suffix != ".part" or "b" not in mode:
            return stream

        class Full:
            def __enter__(self):
                return self

            def __exit__(self, *_):
                stream.close()

            def write(self, piece):
                if stream.tell() >= 65536:
                    raise OSError(errno.ENOSPC, "No space left on device")
                stream.write(piece)

        return Full()

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", full)
        with pytest.raises(FetchError, match="the disk is full: free some space and run the command again"):
            fetch_log(log, tmp_path)
    assert (tmp_path / f"x/source/l.bin.{COMMIT[:12]}.part").stat().st_size == 65536
    (path,) = fetch_log(log, tmp_path)
    assert path == tmp_path / "x/l.bin"
    assert path.read_bytes() == CONTENT
    assert server.requests[-1][1] == "bytes=65536-"


def test_cache_folder_that_cannot_be_written(server, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    log = PublicLog("x", "", "", "", (remote(sha256=SHA256),), "copy")
    with pytest.raises(FetchError, match=r"cannot be written .* --to DIR or the environment variable"):
        fetch_log(log, tmp_path / "file")


def test_cache_folder_by_flag_environment_and_system(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXSLAM_CACHE", str(tmp_path))
    assert cache_folder(Path("~/here")) == Path.home() / "here"
    assert cache_folder() == tmp_path
    monkeypatch.delenv("JAXSLAM_CACHE")
    assert cache_folder().name == "jaxslam"


def test_progress_is_shown_on_a_terminal_only(server, tmp_path, monkeypatch, capsys):
    fetch_files([remote(sha256=SHA256)], tmp_path / "a")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    fetch_files([remote(sha256=SHA256)], tmp_path / "b")
    assert "l:" in capsys.readouterr().err


def test_registry():
    assert {"intel", "csail", "aces", "fr079", "mit-killian", "mines", "wean", "husky"} <= set(PUBLIC_LOGS)
    for log in PUBLIC_LOGS.values():
        names = [file.name for file in log.files]
        assert len(set(names)) == len(names)
        for file in log.files:
            # An abbreviated commit is not enough where the commit is what the file is verified against.
            assert file.sha256 or re.fullmatch("[0-9a-f]{40}", file.commit)


def test_husky_is_the_known_bag(data_dir):
    (file,) = PUBLIC_LOGS["husky"].files
    content = (data_dir / "bags/husky.bag").read_bytes()
    assert (file.size, file.sha256) == (len(content), hashlib.sha256(content).hexdigest())
