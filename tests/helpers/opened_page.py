"""A page in a real browser, with all that it said and asked for."""

from __future__ import annotations

WAIT_MS = 180_000
"""For anything that a page is waited for: drawing without a graphics card is slow where others use the processors."""


class Opened:
    """A page of a browser, opened at a file."""

    def __init__(self, browser, address, **context) -> None:
        self.context = browser.new_context(**context)
        self.page = self.context.new_page()
        self.page.set_default_timeout(WAIT_MS)
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.complaints.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(address.as_uri())

    def ready(self):
        self.page.wait_for_function("window.soundingReport", timeout=WAIT_MS)
        return self.page

    @property
    def state(self):
        return self.page.evaluate("window.soundingReport.state && {...window.soundingReport.state}")
