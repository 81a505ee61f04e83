"""Open a report as its readers do: in the browser of this machine."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
WINDOW = {"width": 1400, "height": 900}


def pytest_addoption(parser):
    parser.addoption(
        "--report-page", type=Path, default=Path("report.html"), help="report to open in a browser"
    )


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.fail(f"none of {', '.join(BROWSERS)} is installed; 'apt install chromium' helps")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found)
        yield browser
        browser.close()


class Complaints(list):
    """What a browser finds wrong with a page, and what the page asks of the network."""

    def __init__(self, page: Page) -> None:
        super().__init__()
        page.on("console", lambda said: said.type == "error" and self.append(said.text))
        page.on("pageerror", lambda error: self.append(str(error)))
        page.on("requestfailed", lambda r: self.append(f"{r.failure}: {r.url[:200]}"))
        page.on("request", lambda request: self._note_address(request.url))

    def _note_address(self, url: str) -> None:
        if not url.startswith(("file:", "data:", "blob:")):
            self.append(f"asked the network for {url[:200]}")


@pytest.fixture(scope="session")
def opened(browser, pytestconfig) -> tuple[Page, Complaints]:
    """The report, and what the browser complains of while it is read."""
    path = pytestconfig.getoption("report_page").resolve()
    assert path.is_file(), f"{path}: no such file, expected a report as 'make report' writes it"
    page = browser.new_page(viewport=WINDOW)
    page.set_default_timeout(300_000)  # drawing in 3D without a GPU takes a slow machine long
    complaints = Complaints(page)
    page.goto(path.as_uri())
    return page, complaints


@pytest.fixture
def report(opened) -> Iterator[Page]:
    """The report at its front page; the test fails if the browser complains of what it reads."""
    page, complaints = opened
    page.locator("nav.h-screen nav a").first.click()
    yield page
    found = [*complaints]
    complaints.clear()  # not the next test's
    assert found == []
