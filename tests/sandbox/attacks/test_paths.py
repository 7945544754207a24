"""What a program learns of files outside its allow-list: with bubblewrap nothing, else what docs/security.md says."""

from pathlib import Path

from tests.sandbox.attacks.conftest import Door
from tests.sandbox.attacks.world import Canaries

LOOK = """
import errno, os
def tried(action, *given):
    try: return action(*given)
    except OSError as error: return errno.errorcode[error.errno]
secret = request["secret"]
folder = os.path.dirname(secret)
value = {"got": {
    "size": tried(lambda: os.stat(secret).st_size),
    "absent": tried(os.stat, secret + ".not"),
    "content": tried(open, secret),
    "names": tried(os.listdir, folder),
    "link": tried(os.readlink, request["link"]),
}}
"""


def test_without_bubblewrap_facts_of_a_path_show_but_neither_content_nor_names(
    door: Door, watched: Canaries, tmp_path: Path
) -> None:
    (tmp_path / "link").symlink_to("somewhere")
    result = door.execute(LOOK, {"secret": watched.world["key_file"], "link": str(tmp_path / "link")})
    assert result.value is not None, result.error
    if door.backend == "bubblewrap":
        assert set(result.value["got"].values()) == {"ENOENT"}
        return
    assert result.value["got"] == {
        "size": len(watched.secret),
        "absent": "ENOENT",
        "content": "EACCES",
        "names": "EACCES",
        "link": "somewhere",
    }
