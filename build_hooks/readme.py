"""The README as a package index shows it: pictures and links lead to the project's repository."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

REPOSITORY = "Repository"  # its entry under [project.urls]
LINK = re.compile(r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?!https?://|#)(?P<path>[^)]+)\)")


class ReadmeHook(MetadataHookInterface):
    """Sets the project's long description."""

    PLUGIN_NAME = "custom"

    def update(self, metadata: dict[str, Any]) -> None:
        """Read README.md and point its links to the repository, if the project names one."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        repository = metadata.get("urls", {}).get(REPOSITORY)
        text = readme(text, repository, f"v{metadata['version']}")
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def readme(text: str, repository: str | None, tag: str) -> str:
    """Return a README whose links lead somewhere from everywhere.

    An index shows no picture that lies beside the README. Without a repository to take them from,
    pictures and links to files become their words: nothing on the page is broken.

    Args:
        text: The README, with links to files beside it.
        repository: Its address; files are below ``raw`` and ``blob`` there.
        tag: The state of the repository that the links mean.
    """

    def turned(link: re.Match[str]) -> str:
        picture, words, path = link["picture"], link["text"], link["path"]
        if repository is None:
            return f"*{words}*" if picture else words
        base = f"{repository.rstrip('/')}/{'raw' if picture else 'blob'}/{tag}"
        return f"{picture}[{words}]({base}/{path})"

    return LINK.sub(turned, text)
