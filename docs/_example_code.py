"""A hook of mkdocs: a comment `<!-- code: examples/NAME.py -->` is replaced by the file itself, so that none drifts.

On a code host the comment is invisible, and the link to the file beside it leads there.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
COMMENT = re.compile(r"^<!-- code: (examples/\w+\.py) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """The page with the code of its example in it; a file that is not there fails the build."""
    return COMMENT.sub(
        lambda match: f"```python\n{(ROOT / match[1]).read_text(encoding='utf-8')}```", markdown
    )
