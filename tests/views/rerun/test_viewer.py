"""Opening the viewer."""

import contextlib
import socket
from pathlib import Path

import pytest

from grs_agents.base.errors import InputError
from grs_agents.views.rerun.viewer import (
    WEB_PORT,
    WebAddress,
    find_recordings,
    has_display,
    open_viewer,
    viewer_command,
    viewer_environment,
)
from tests.needs import needs


def test_the_viewer_listens_to_this_machine_alone(tmp_path: Path) -> None:
    (tmp_path / "trace.rrd").touch()
    (tmp_path / "trace.1.rrd").touch()
    for web in (None, WebAddress(page=9091, data=9092)):
        command = viewer_command(tmp_path, web)
        assert command[command.index("--bind") + 1] == "127.0.0.1"
        assert ("--web-viewer" in command) == (web is not None)
        assert web is None or {"9091", "9092"} <= set(command)
        shown = {Path(part).name for part in command}
        assert "-" in shown if web else shown >= {"trace.rrd", "trace.1.rrd"}


def test_the_page_in_the_browser_is_on_a_port_that_is_free() -> None:
    usual = WebAddress.with_free_ports()
    assert usual.url == f"http://127.0.0.1:{usual.page}?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{usual.data}%2Fproxy"
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with contextlib.suppress(OSError):
            other.bind(("127.0.0.1", WEB_PORT))
            other.listen()
        assert WebAddress.with_free_ports().page != WEB_PORT


def test_no_usage_data_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    assert viewer_environment()["CI"] == "1"
    assert "FORCE_RERUN_ANALYTICS" not in viewer_environment()


def test_a_folder_without_a_recording_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no recording"):
        find_recordings(tmp_path)
    with pytest.raises(InputError, match="no recording"):
        viewer_command(tmp_path / "trace.rrd")


@needs("64-bit linux")  # elsewhere there is always a display
def test_without_a_display_the_error_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trace.rrd").touch()
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match=r"no display.*--web.*rerun trace.rrd"), open_viewer(tmp_path):
        pass


def test_a_display_is_x11_wayland_or_another_system() -> None:
    assert has_display({"WAYLAND_DISPLAY": "wayland-0"}, "linux")
    assert has_display({"DISPLAY": ":0"}, "linux")
    assert not has_display({}, "linux")
    assert has_display({}, "darwin")
