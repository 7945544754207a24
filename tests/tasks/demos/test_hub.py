"""Upload of a data set by the real client to a server on loopback that answers as the Hub does."""

import base64
import json
from collections.abc import Generator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from grs_agents.base.errors import GrsError, InputError
from grs_agents.tasks.demos.hub import check_hub_requirements, push_dataset
from tests.needs import needs

pytestmark = needs("huggingface_hub")


class Hub(ThreadingHTTPServer):
    """Keeps the files and tags of data sets."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files: dict[str, bytes] = {}
        self.tags: list[str] = []
        self.repositories: list[dict[str, Any]] = []
        self.refuses = False

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class _Handler(BaseHTTPRequestHandler):
    @property
    def hub(self) -> Hub:
        """The server, typed."""
        assert isinstance(self.server, Hub)
        return self.server

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if self.hub.refuses or self.headers.get("authorization") != "Bearer hf_secret":
            self._answer({"error": "Invalid credentials in Authorization header"}, 401)
        elif self.path == "/api/repos/create":
            self.hub.repositories.append(json.loads(body))
            self._answer({"url": f"{self.hub.address}/datasets/lab/boxes", "name": "lab/boxes"})
        elif self.path == "/api/validate-yaml":  # of the card's head
            self._answer({"errors": [], "warnings": []})
        elif "/preupload/" in self.path:
            named = [file["path"] for file in json.loads(body)["files"]]
            self._answer({"files": [{"path": n, "uploadMode": "regular", "shouldIgnore": False} for n in named]})
        elif "/commit/" in self.path:
            for line in map(json.loads, body.splitlines()):
                if line["key"] == "file":
                    self.hub.files[line["value"]["path"]] = base64.b64decode(line["value"]["content"])
            where = f"{self.hub.address}/datasets/lab/boxes/commit/main"
            self._answer({"commitUrl": where, "commitOid": "0" * 40, "success": True})
        elif "/tag/" in self.path:
            self.hub.tags.append(json.loads(body)["tag"])
            self._answer({})
        else:
            self._answer({"error": self.path}, 404)

    def do_DELETE(self) -> None:
        self.send_response(404)
        self.send_header("X-Error-Code", "RevisionNotFound")
        self.end_headers()

    def do_GET(self) -> None:
        self._answer({"sha": "0" * 40, "id": "lab/boxes", "siblings": []})

    def log_message(self, *args: Any, **named: Any) -> None:
        """Stay silent."""

    def _answer(self, value: object, status: int = 200) -> None:
        body = json.dumps(value).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch) -> Generator[Hub]:
    """The Hub of this process."""
    with Hub() as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        monkeypatch.setattr("huggingface_hub.constants.ENDPOINT", server.address)
        monkeypatch.setenv("HF_TOKEN", "hf_secret")
        yield server
        server.shutdown()


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A data set with the files that the card is made of."""
    folder = tmp_path / "boxes-demos"
    (folder / "meta").mkdir(parents=True)
    (folder / "data").mkdir()
    (folder / "data" / "file-000.parquet").write_bytes(b"PAR1")
    info = {"codebase_version": "v3.0", "fps": 25, "total_frames": 412, "features": {"action": {"shape": [7]}}}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    described = {
        "format": "lerobot",
        "dataset": {
            "robot": "panda",
            "joint_names": ["joint1"],
            "object_names": ["red | <b>box</b>"],
            "cameras": [{"name": "front"}],
            "versions": {"mujoco": "3.4.0"},
        },
        "order": {"episodes": 2},
        "episodes": [{"language": "Put the red box on the zone."}, {"language": "Put the red box on the zone."}],
    }
    (folder / "grs.json").write_text(json.dumps(described))
    return folder


def test_a_data_set_is_uploaded_with_a_card_and_the_tag_that_lerobot_loads(hub: Hub, dataset: Path) -> None:
    check_hub_requirements("lab/boxes")
    assert push_dataset(dataset, "lab/boxes", private=True) == f"{hub.address}/datasets/lab/boxes"
    (made,) = hub.repositories
    assert made["name"] == "boxes" and made["organization"] == "lab" and made["type"] == "dataset"
    assert made.get("private") is True or made.get("visibility") == "private"
    assert hub.files.keys() == {"README.md", "data/file-000.parquet", "meta/info.json", "grs.json"}
    assert hub.files["data/file-000.parquet"] == b"PAR1" and hub.tags == ["v3.0"]
    card = hub.files["README.md"].decode()
    assert card.startswith("---\ntask_categories:\n- robotics\n")
    assert "2 demonstrations (412 steps at 25 Hz)" in card and card.count("> Put the red box on the zone.") == 1
    assert "red / &lt;b>box&lt;/b>" in card and "| `action` | 7 |" in card


def test_a_refusal_of_the_hub_is_an_error_that_names_it(hub: Hub, dataset: Path) -> None:
    hub.refuses = True
    with pytest.raises(GrsError, match=r"the Hub did not take lab/boxes: .*401") as refused:
        push_dataset(dataset, "lab/boxes", private=False)
    assert "hf_secret" not in str(refused.value)


def test_a_hub_that_is_not_reached_and_a_faulty_data_set_are_errors_that_name_it(hub: Hub, dataset: Path) -> None:
    hub.shutdown()
    hub.server_close()
    with pytest.raises(GrsError, match=r"the Hub did not take lab/boxes: .*refused"):
        push_dataset(dataset, "lab/boxes", private=False)
    (dataset / "data" / "secret").symlink_to(dataset.parent / "key")
    with pytest.raises(InputError, match="secret is a link"):
        push_dataset(dataset, "lab/boxes", private=False)
    (dataset / "data" / "secret").unlink()
    (dataset / "meta" / "info.json").write_text("{}")
    with pytest.raises(InputError, match="is a damaged data set: KeyError"):
        push_dataset(dataset, "lab/boxes", private=False)


def test_other_formats_names_and_no_login_are_refused(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    described = json.loads((dataset / "grs.json").read_text())
    (dataset / "grs.json").write_text(json.dumps({**described, "format": "robomimic"}))
    with pytest.raises(InputError, match="robomimic"):
        push_dataset(dataset, "lab/boxes", private=False)
    for name in ("boxes", "lab/bo xes", "lab/boxes/x"):
        with pytest.raises(InputError, match="no name of a data set"):
            check_hub_requirements(name)
    monkeypatch.setattr("huggingface_hub.get_token", lambda: None)
    with pytest.raises(InputError, match="nobody is logged in"):
        check_hub_requirements("lab/boxes")
