"""What a program learns of files outside its allow-list: with bubblewrap nothing, else what docs/security.md says."""

from tests.sandbox.attacks.conftest import Door
from tests.sandbox.attacks.world import REPOSITORY, Canaries

LOOK = """
import errno, os
def tried(action):
    try: return action()
    except OSError as error: return errno.errorcode[error.errno]
secret = request["secret"]
value = {"got": {
    "size": tried(lambda: os.stat(secret).st_size),
    "absent": tried(lambda: os.stat(secret + ".not").st_size),
    "content": tried(lambda: open(secret).read()),
    "names": tried(lambda: os.listdir(os.path.dirname(secret))),
}}
"""


def test_without_bubblewrap_facts_of_a_path_show_but_neither_content_nor_names(door: Door, watched: Canaries) -> None:
    secret = next(path for path in watched.world["files"] if path.startswith(f"{REPOSITORY}/"))
    result = door.execute(LOOK, {"secret": secret})
    assert result.value is not None, result.error
    got = result.value["got"]
    if door.backend == "bubblewrap":
        assert (got["size"], got["absent"], got["content"]) == ("ENOENT", "ENOENT", "ENOENT")
        assert "README.md" not in got["names"]
    else:
        assert got == {"size": len(watched.secret), "absent": "ENOENT", "content": "EACCES", "names": "EACCES"}
