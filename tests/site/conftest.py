"""A server for the folder site/, and Debian's Chromium, which reaches nothing but that server."""

import functools
import http.server
import shutil
import threading
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

SITE = Path(__file__).parents[2] / "site"
NAMES = ("chromium", "chromium-browser", "google-chrome")
DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}
measured = {}  # what the last lines of the run tell


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files without a line for each."""

    def log_message(self, *_):
        """Say nothing."""


@pytest.fixture(scope="session")
def address():
    """Address of a plain http.server over site/."""
    handler = functools.partial(Quiet, directory=SITE)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture(scope="session")
def browser():
    """Give the machine's own Chromium, without a screen."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if not found:
        pytest.fail("no Chromium on this machine; for example: apt-get install chromium")
    with sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture(scope="session")
def visit(browser, address):
    """Open a page of the site in a fresh window; its ``troubles`` list whatever went wrong."""

    def opened(path="index.html", size=DESKTOP, root=address, **options):
        window = browser.new_context(viewport=size, accept_downloads=True, **options)
        window.set_default_timeout(120_000)  # for a machine that does more than this
        page, troubles = window.new_page(), []
        page.route(
            lambda url: not url.startswith((root, "data:", "blob:")),
            lambda route: (troubles.append(f"asks for {route.request.url}"), route.abort()),
        )
        page.on("console", lambda m: m.type == "error" and troubles.append(m.text))
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.on("requestfailed", lambda r: troubles.append(f"{r.url}: {r.failure}"))
        page.on("response", lambda r: r.status < 400 or troubles.append(f"{r.status} {r.url}"))
        page.troubles = troubles
        page.goto(root + path, wait_until="load")
        return page

    return opened


@pytest.fixture(autouse=True)
def closed(request):
    """Close the windows that a test opens, and leave those that several tests share."""
    browser = request.getfixturevalue("browser") if "visit" in request.fixturenames else None
    shared = browser.contexts if browser else []
    yield
    for window in browser.contexts if browser else []:
        if window not in shared:
            window.close()


def pytest_terminal_summary(terminalreporter):
    """Say how much was looked at, and what was measured."""
    for what, value in measured.items():
        terminalreporter.write_line(f"{what}: {value}")
