"""Public bug reports as small inputs, in a folder beside the repository; tests of them skip where it is absent."""

import shutil
from pathlib import Path

from tests.needs import require

CASES = Path(__file__).parents[3] / "shared" / "cases"


def copy_case(name: str, folder: Path) -> Path:
    """Copy the case ``name`` without its README into ``folder``; the copy. Skips the test where there are no cases."""
    require(str(CASES / name))
    return shutil.copytree(CASES / name, folder / name, ignore=shutil.ignore_patterns("README"))
