"""Upload of a LeRobot data set to the Hugging Face Hub, with a data card."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.errors import ConfigError, GrsError, InputError
from grs_agents.base.files import refuse_link
from grs_agents.base.foreign.files import read_json
from grs_agents.base.templates import load_template
from grs_agents.tasks.task_folder import DATASET_FILE

_REMEDY: Final = "name a folder that `grs demos` wrote"
_CARD: Final = "README.md"


def check_hub_requirements(repo: str) -> None:
    """Check before anything is simulated that a data set can be uploaded to ``repo``, ``USER/NAME``.

    Raises:
        ConfigError: huggingface_hub is not installed.
        InputError: ``repo`` is no name of a data set, or nobody is logged in.
    """
    try:
        import huggingface_hub
        from huggingface_hub.errors import HFValidationError
        from huggingface_hub.utils import validate_repo_id
    except ImportError as error:
        remedy = 'run: pip install "grs-agents[demos]"'
        raise ConfigError("huggingface_hub, which --push-to-hub needs, is not installed", remedy) from error
    try:
        validate_repo_id(repo)
    except HFValidationError as error:
        raise InputError(f"{repo!r} is no name of a data set: {error}", "name it as USER/NAME") from error
    if repo.count("/") != 1:
        raise InputError(f"{repo!r} is no name of a data set", "name it as USER/NAME")
    if huggingface_hub.get_token() is None:
        raise InputError("nobody is logged in at the Hugging Face Hub", "run `hf auth login`, or set HF_TOKEN")


def push_dataset(folder: Path, repo: str, private: bool) -> str:
    """Upload a LeRobot data set with a data card, and tag it with the version of its format. Returns: its address.

    Raises:
        InputError: ``folder`` is no LeRobot data set (other formats hold absolute paths of this machine), is damaged,
            or holds a link.
        GrsError: the Hub refuses it or cannot be reached.
    """
    from huggingface_hub import CommitOperationAdd, HfApi
    from huggingface_hub.errors import RevisionNotFoundError

    description = read_json(folder / DATASET_FILE, _REMEDY)
    if description.get("format") != "lerobot":
        raise InputError(f"{folder} is in the format {description.get('format')!r}", "upload a data set of LeRobot's")
    for file in folder.rglob("*"):
        refuse_link(file)  # the folder may come from somebody else, and what a link names would be published
    info = read_json(folder / "meta" / "info.json", _REMEDY)
    try:
        card, version = _make_card(description, info, repo), str(info["codebase_version"])
    except (LookupError, TypeError, AttributeError) as error:
        raise InputError(f"{folder} is a damaged data set: {error!r}", _REMEDY) from error
    hub = HfApi(library_name="grs-agents")
    try:
        address = hub.create_repo(repo, repo_type="dataset", private=private, exist_ok=True)
        hub.upload_folder(repo_id=repo, repo_type="dataset", folder_path=folder, ignore_patterns=[_CARD])
        added = [CommitOperationAdd(_CARD, card.encode())]
        hub.create_commit(repo, added, repo_type="dataset", commit_message="Data card")
        with suppress(RevisionNotFoundError):
            hub.delete_tag(repo, tag=version, repo_type="dataset")  # LeRobot loads the revision with this tag
        hub.create_tag(repo, tag=version, repo_type="dataset")
    except Exception as error:  # of requests or httpx, by the version of huggingface_hub
        lines = str(error).strip().splitlines() or [repr(error)]
        reason = escape_control_chars(lines[0])
        raise GrsError(f"the Hub did not take {repo}: {reason}", "see the network, and `hf auth whoami`") from error
    return str(address)


def _make_card(description: dict[str, Any], info: dict[str, Any], repo: str) -> str:
    episodes: list[dict[str, Any]] = description["episodes"]
    features = {name: ", ".join(map(str, value["shape"])) for name, value in info["features"].items() if name[0] != "_"}
    return load_template(Path(__file__).with_name("card.md"), line=_write_on_one_line).render(
        repo=repo,
        data=description["dataset"],
        order=json.dumps(description["order"], indent=2),
        episodes=len(episodes),
        steps=info["total_frames"],
        fps=info["fps"],
        version=info["codebase_version"],
        sentences=list(dict.fromkeys(str(episode["language"]) for episode in episodes))[:10],
        features=features,
    )


def _write_on_one_line(text: str) -> str:
    """Foreign text for a line of Markdown."""
    return escape_control_chars(" ".join(text.split())).replace("|", "/").replace("<", "&lt;")
