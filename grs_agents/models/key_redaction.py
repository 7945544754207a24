"""The keys that this process may send to providers, kept out of all that a provider says."""

import os

REMOVED = "[removed]"
_SHORTEST = 8
"""Characters. A shorter value, such as the ``none`` that a local server is content with, is no secret, and would be
found in any program."""
_variables = {"OLLAMA_API_KEY", "AWS_SESSION_TOKEN", "AWS_BEARER_TOKEN_BEDROCK"}  # clients read these by themselves


def register_key_variable(variable: str) -> None:
    """From now on the environment variable of this name is known to hold a key."""
    _variables.add(variable)


def redact_keys(text: str) -> str:
    """What a provider said, without the keys that this process knows, and as text that UTF-8 can hold.

    Every text that comes from a provider, errors included, passes here before anything else is done with it.
    """
    keys = {os.environ.get(name, "").strip() for name in _variables}
    for key in sorted(keys, key=len, reverse=True):  # one may be the beginning of another
        if len(key) >= _SHORTEST:
            text = text.replace(key, REMOVED)
    return text.encode("utf-8", "replace").decode("utf-8")
