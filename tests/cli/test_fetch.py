"""`jaxslam fetch`: the listing, a whole fetch from the loopback address, and bad input."""

import http.server
import shlex
import threading

import pytest

import jaxslam.io.download as fetch
from jaxslam.cli.fetch import next_command
from jaxslam.cli.main import main
from jaxslam.io.public_logs import PUBLIC_LOGS


@pytest.fixture
def bag_server(data_dir, monkeypatch):
    content = (data_dir / "bags/husky.bag").read_bytes()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *args):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr(fetch, "FILE_URL", f"http://127.0.0.1:{server.server_address[1]}/{{path}}")
    yield server
    server.shutdown()
    server.server_close()


def test_listing_names_every_log_and_warns_of_corrected_odometry(capsys):
    assert main(["fetch"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if line[0] != " "][:-1] == list(PUBLIC_LOGS)
    assert max(map(len, lines)) <= 120
    assert "do not measure a filter's accuracy" in " ".join(" ".join(lines).split())
    assert next(line for line in lines if line.startswith("husky")).split()[1:3] == ["1.5", "MB"]


def test_fetched_bag_can_be_used_by_the_next_command(bag_server, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JAXSLAM_CACHE", str(tmp_path / "unused"))
    folder = tmp_path / "with blank"
    assert main(["fetch", "husky", "--to", str(folder)]) == 0
    path, following = capsys.readouterr().out.splitlines()
    assert path == str(folder / "husky/husky.bag")
    words = shlex.split(following.removeprefix("next: "))
    assert words == ["jaxslam", "fuse", path, "--gps"]
    assert main(["info", path]) == 0
    assert not (tmp_path / "unused").exists()


@pytest.mark.parametrize(
    ("name", "files", "expected"),
    [
        ("intel", ["intel.clf.gz", "intel.relations"], "run intel.clf.gz --relations intel.relations"),
        (
            "csail",
            ["csail.clf.gz", "csail.reference.tum"],
            "run csail.clf.gz --reference csail.reference.tum",
        ),
        ("wean", ["a.clf.gz", "b.clf.gz", "wean.yaml"], "localize a.clf.gz --map wean.yaml --global"),
    ],
)
def test_next_command(tmp_path, name, files, expected):
    command = next_command(PUBLIC_LOGS[name], [tmp_path / file for file in files])
    assert command.replace(f"{tmp_path}/", "") == f"jaxslam {expected}"


@pytest.mark.parametrize(
    ("name", "hint"),
    [("intell", "did you mean 'intel'? There are"), ("zzz", "log is called 'zzz': There are intel,")],
)
def test_unknown_log(name, hint, capsys):
    assert main(["fetch", name]) == 2
    error = capsys.readouterr().err
    assert hint in error
    assert error.count("\n") == 1


def test_no_network_is_one_line(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr(fetch, "FILE_URL", "http://127.0.0.1:1/{path}")
    assert main(["fetch", "husky", "--to", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("jaxslam: error: cannot reach 127.0.0.1:1 (no connection): check the network, or")
    assert error.endswith(f"copy its folder husky to {tmp_path / 'husky'}\n")
    assert error.count("\n") == 1
