"""Redaction: the keys that this process may send to providers are kept out of all text from providers."""

import os

REMOVED = "[removed]"
_SHORTEST = 8
"""Characters. A shorter value, such as ``none`` for a local server, is no secret and occurs in any program."""
_variables = {"OLLAMA_API_KEY", "AWS_SESSION_TOKEN", "AWS_BEARER_TOKEN_BEDROCK"}  # clients read these by themselves


def register_key_variable(variable: str) -> None:
    """Register an environment variable as the holder of a key."""
    _variables.add(variable)


def redact_keys(text: str) -> str:
    """Remove from a provider's text the keys that this process knows, and replace text that UTF-8 cannot encode.

    Every text from a provider, errors included, passes here before any other use.
    """
    keys = {os.environ.get(name, "").strip() for name in _variables}
    for key in sorted(keys, key=len, reverse=True):  # a key may be a prefix of another
        if len(key) >= _SHORTEST:
            text = text.replace(key, REMOVED)
    return text.encode("utf-8", "replace").decode("utf-8")
