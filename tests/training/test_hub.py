"""The Hugging Face Hub: names, and a run that goes to a server of this machine, and back."""

import base64
import hashlib
import http.server
import json
import threading

import pytest
from fresh_python import run_python

from sb3_piano.exceptions import ConfigError
from sb3_piano.training import load_player

COMMIT = "0123456789abcdef0123456789abcdef01234567"


class Hub(http.server.BaseHTTPRequestHandler):
    """Answers as the Hub does for a repository, whose files its server keeps in a folder."""

    def log_message(self, *arguments):
        pass

    def do_HEAD(self):
        self.answer(False)

    def do_GET(self):
        self.answer(True)

    def do_POST(self):
        folder = self.server.kept
        body = self.rfile.read(int(self.headers["Content-Length"]))
        if self.path.endswith("/api/repos/create"):
            asked = json.loads(body)
            self.server.asked.append(f"{asked['organization']}/{asked['name']}")
            self.send({"url": f"http://{self.headers['Host']}/a/b"})
        elif "/preupload/" in self.path:
            how = {"uploadMode": "regular", "shouldIgnore": False}
            self.send({"files": [{**how, "path": f["path"]} for f in json.loads(body)["files"]]})
        elif "/commit/" in self.path:
            for line in map(json.loads, body.splitlines()):
                if line["key"] == "file":
                    file = folder / line["value"]["path"]
                    file.parent.mkdir(parents=True, exist_ok=True)
                    file.write_bytes(base64.b64decode(line["value"]["content"]))
            url = f"http://{self.headers['Host']}/a/b/commit/{COMMIT}"
            self.send({"commitUrl": url, "commitOid": COMMIT})
        else:  # the card's heading is checked
            self.send({"errors": [], "warnings": []})

    def answer(self, with_body):
        path, folder = self.path.partition("?")[0], self.server.kept
        files = [f for f in folder.rglob("*") if f.is_file()]
        names = [str(f.relative_to(folder)) for f in files]
        if "/resolve/" in path:
            file = folder / path.split("/resolve/")[1].partition("/")[2]
            if not file.is_file():
                self.send_error(404)
                return
            body = file.read_bytes()
        elif "/tree/" in path:
            sizes = zip(names, (f.stat().st_size for f in files), strict=True)
            body = [{"type": "file", "path": n, "size": size, "oid": "0"} for n, size in sizes]
        else:
            siblings = [{"rfilename": name} for name in names]
            body = {"id": "a/b", "sha": COMMIT, "siblings": siblings}
        self.send(body, with_body)

    def send(self, content, with_body=True):
        body = content if isinstance(content, bytes) else json.dumps(content).encode()
        self.send_response(200)
        self.send_header("ETag", f'"{hashlib.sha1(body).hexdigest()}"')
        self.send_header("X-Repo-Commit", COMMIT)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)


def test_a_name_that_is_no_repository_is_refused():
    with pytest.raises(ConfigError, match="expected hf://OWNER/NAME"):
        load_player("hf:nothing")


@pytest.mark.slow
def test_a_run_is_published_and_fetched_without_its_pickles(pendulum_run, tmp_path, monkeypatch):
    pytest.importorskip("huggingface_hub")
    kept = tmp_path / "kept"
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Hub)
    server.kept, server.asked = kept, []
    threading.Thread(target=server.serve_forever, daemon=True).start()
    export = ["export", str(pendulum_run().path), str(tmp_path / "exported"), "--episodes", "1"]
    code = (
        "from sb3_piano.cli import main\n"
        "from sb3_piano.training import RunFolder, load_player\n"
        "from sb3_piano.training.sharing.hub import push_to_hub\n"
        f"status = main({[*export, '--no-video', '--push-to-hub', 'a/b']})\n"
        f"push_to_hub(RunFolder.open({str(tmp_path / 'exported')!r}), 'a')\n"
        f"open({str(kept / 'model.zip')!r}, 'w').write('a pickle')\n"
        "with load_player('hf://a/b') as player:\n"
        "    there = (player.run.path / 'model.zip').exists()\n"
        "    print(status, player.play()[0].metrics['return'], there)\n"
    )
    for name, value in {
        "HF_ENDPOINT": f"http://127.0.0.1:{server.server_port}",
        "HF_HOME": str(tmp_path / "cache"),
        "HF_TOKEN": "hf_of_a_test",
        "HF_HUB_DISABLE_XET": "1",
    }.items():
        monkeypatch.setenv(name, value)
    done = run_python(["-c", code], tmp_path)
    server.shutdown()
    assert done.returncode == 0, done.stderr
    assert f"Hub:      http://127.0.0.1:{server.server_port}/a/b" in done.stdout
    assert server.asked == ["a/b", "a/td3-Pendulum-v1"]
    with load_player(tmp_path / "exported") as player:
        wanted = player.play()[0].metrics["return"]
    assert done.stdout.split()[-3:] == ["0", str(wanted), "False"]
    sent = {str(path.relative_to(kept)) for path in kept.rglob("*") if path.is_file()}
    assert {"README.md", "config.yml", "policy.safetensors", "evaluation/metrics.json"} <= sent
