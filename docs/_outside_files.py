"""A hook of mkdocs: pages may link to files of the repository outside docs/, which the site then holds as well."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"\]\(\.\./([^)#\s]+)\)")
FOLDER = "repository"
"""Where in the site they lie."""


def on_files(files: Any, config: Any) -> Any:
    """Add every file outside that a page links to."""
    for page in list(files.documentation_pages()):
        for target in LINK.findall(Path(page.abs_src_path).read_text(encoding="utf-8")):
            name = f"{FOLDER}/{target}"
            if (ROOT / target).is_file() and files.get_file_from_path(name) is None:
                files.append(File.generated(config, name, abs_src_path=str(ROOT / target)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Lead the links there."""

    def led(match: re.Match[str]) -> str:
        return f"]({FOLDER}/{match[1]})" if (ROOT / match[1]).is_file() else match[0]

    return LINK.sub(led, markdown)
