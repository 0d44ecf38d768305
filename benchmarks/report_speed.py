"""How long a report takes to be drawn in a browser, from the start of the navigation.

    .venv/bin/python -m benchmarks.report_speed renders/first/report.html --loads 7

Chromium runs without a window or a graphics card: the processor draws the page and, by SwiftShader, WebGL. Each load
has a profile of its own. `drawn` is when the graphics process has finished the first complete picture (pixels can be
read) and the next frame has begun.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import tyro

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ARGUMENTS = ("--no-sandbox", "--enable-unsafe-swiftshader")
WAIT_S = 60
PROBE = """async () => {
  const frame = () => new Promise(resolve => requestAnimationFrame(() => setTimeout(resolve)));
  while (!window.soundingReport) await new Promise(resolve => setTimeout(resolve, 5));
  const script_ms = window.soundingReport.sinceLoadMs;
  await frame();
  const gl = document.getElementById("canvas").getContext("webgl2");
  if (gl) gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  await frame();
  return { script: script_ms, drawn: performance.now(), error: window.soundingReport.error };
}"""


@dataclass(frozen=True)
class Options:
    """Open reports, and measure how long they take to be drawn."""

    files: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Files report.html of runs."""
    loads: int = 7
    """How often each file is opened."""
    width_px: int = 1280
    """Width of the page [pixels]."""
    height_px: int = 900
    """Height of the page [pixels]."""


def launch(driver: Any) -> Any:
    """The Chromium of this machine."""
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        raise SystemExit("no Chromium is installed: apt-get install chromium")
    return driver.chromium.launch(executable_path=path, args=list(ARGUMENTS))


def load_once(browser: Any, file: Path, options: Options) -> dict[str, Any]:
    """The milliseconds from the start of the navigation to the script's end and to the finished picture."""
    context = browser.new_context(viewport={"width": options.width_px, "height": options.height_px})
    page = context.new_page()
    page.goto(file.resolve().as_uri(), wait_until="commit", timeout=WAIT_S * 1e3)
    times = page.evaluate(PROBE)
    context.close()
    return times


def main(options: Options) -> None:
    """Print a line per report."""
    from playwright.sync_api import sync_playwright

    print(f"median and range of {options.loads} loads [ms], {options.width_px} x {options.height_px} px")
    with sync_playwright() as driver:
        for file in options.files:
            browser = launch(driver)
            runs = [load_once(browser, file, options) for _ in range(options.loads)]
            browser.close()
            errors = {run["error"] for run in runs} - {None}
            columns = []
            for name in ("script", "drawn"):
                times = sorted(run[name] for run in runs)
                columns.append(f"{name} {median(times):.0f} ({times[0]:.0f}-{times[-1]:.0f})")
            print(f"{file}: {file.stat().st_size / 1e6:.1f} MB, {', '.join(columns)}", *errors)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
