"""A page in a real browser, with all that it said and asked for."""

from __future__ import annotations


class Opened:
    """A page of a browser, opened at a file."""

    def __init__(self, browser, address, **context) -> None:
        self.context = browser.new_context(**context)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.complaints.append(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(address.as_uri())

    def ready(self):
        self.page.wait_for_function("window.soundingReport", timeout=60_000)
        return self.page

    @property
    def state(self):
        return self.page.evaluate("window.soundingReport.state && {...window.soundingReport.state}")
