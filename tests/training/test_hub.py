"""The Hugging Face Hub: names, and a run that is fetched from a server of this machine."""

from __future__ import annotations

import hashlib
import http.server
import json
import subprocess
import sys
import threading

import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.training import export_run, load_player

COMMIT = "0123456789abcdef0123456789abcdef01234567"


def hub_of(folder):
    """Return a class that answers as the Hub does for a repository with the files of a folder."""

    class Hub(http.server.BaseHTTPRequestHandler):
        def log_message(self, *arguments):
            pass

        def do_HEAD(self):
            self.answer(False)

        def do_GET(self):
            self.answer(True)

        def answer(self, with_body):
            path = self.path.partition("?")[0]
            files = [f for f in folder.rglob("*") if f.is_file()]
            names = [str(f.relative_to(folder)) for f in files]
            if "/resolve/" in path:
                body = (folder / path.split(f"/resolve/{COMMIT}/")[1]).read_bytes()
            elif "/tree/" in path:
                body = json.dumps(
                    [
                        {"type": "file", "path": n, "size": f.stat().st_size, "oid": "0"}
                        for n, f in zip(names, files, strict=True)
                    ]
                ).encode()
            else:
                siblings = [{"rfilename": name} for name in names]
                body = json.dumps({"id": "a/b", "sha": COMMIT, "siblings": siblings}).encode()
            self.send_response(200)
            self.send_header("ETag", f'"{hashlib.sha1(body).hexdigest()}"')
            self.send_header("X-Repo-Commit", COMMIT)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if with_body:
                self.wfile.write(body)

    return Hub


def test_a_name_that_is_no_repository_is_refused():
    with pytest.raises(ConfigError, match="expected hf://OWNER/NAME"):
        load_player("hf:nothing")


@pytest.mark.slow
def test_a_run_is_fetched_without_its_pickles(pendulum_run, tmp_path):
    pytest.importorskip("huggingface_sb3")
    exported = export_run(pendulum_run().path, tmp_path / "exported", episodes=1)
    (exported.path / "model.zip").write_bytes(b"a pickle")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), hub_of(exported.path))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    code = (
        "from sb3_piano.training import load_player\n"
        "with load_player('hf://a/b') as player:\n"
        "    print(player.play()[0].metrics['return'], (player.run.path / 'model.zip').exists())\n"
    )
    environment = {
        "HF_ENDPOINT": f"http://127.0.0.1:{server.server_port}",
        "HF_HOME": str(tmp_path / "cache"),
        "PATH": "/usr/bin:/bin",
        "OMP_NUM_THREADS": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment
    )
    server.shutdown()
    assert done.returncode == 0, done.stderr
    with load_player(exported.path) as player:
        wanted = player.play()[0].metrics["return"]
    assert done.stdout.split() == [str(wanted), "False"]
