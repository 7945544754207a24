"""An OpenAI-compatible chat server on loopback, whose answers a function makes."""

import contextlib
import json
from collections.abc import Callable, Generator, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

Json = dict[str, Any]
Answer = tuple[int, Mapping[str, str], bytes]
"""Status, headers and body."""


def completion(message: Json, usage: Json, finish: str | None = "stop") -> Json:
    """The body of a chat completion with one choice."""
    return {
        "id": "x",
        "object": "chat.completion",
        "created": 1,
        "model": "any",
        "choices": [{"index": 0, "message": {"role": "assistant", **message}, "finish_reason": finish}],
        "usage": usage,
    }


@contextlib.contextmanager
def chat_server(answer: Callable[[Json, str], Answer]) -> Generator[str]:
    """Serve until the end; the base URL.

    Args:
        answer: makes the answer from a request's body and its ``Authorization`` header.
    """

    class Handler(BaseHTTPRequestHandler):
        def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
            """Stay silent."""

        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers.get("Content-Length", 0))))
            status, headers, data = answer(body, self.headers.get("Authorization", ""))
            with contextlib.suppress(OSError):  # the client was killed
                self.send_response(status)
                for name, value in {"Content-Type": "application/json", **headers}.items():
                    self.send_header(name, value)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}/v1"
    server.shutdown()
    thread.join()
    server.server_close()
