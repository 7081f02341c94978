"""The option `--candidates`."""

from __future__ import annotations

from viewsep.errors import BadInput


def candidate_names(text: str | None) -> list[str]:
    """Names from a comma-separated option; all candidates for None. Raises BadInput."""
    if text is None:
        return []
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise BadInput(f"--candidates {text!r} has an empty name: write e.g. --candidates tea,tea_decaf")
    return names
