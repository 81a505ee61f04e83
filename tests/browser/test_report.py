"""Every page of a report can be opened, seen and read to its end in a browser.

`make test-browser REPORT=report.html` runs this on a finished report.
"""

import io

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import ElementHandle, Frame, Locator, Page

PAGE_BYTES_MAX = 1_500_000  # Chromium opens no frame whose data URL is longer than 2 MiB
GENERAL = ["Workflow", "Statistics", "About"]


def menu(report: Page) -> Locator:
    """The bar at the left, at the list of all there is."""
    bar = report.locator("nav.h-screen")
    bar.locator("nav a").first.click()
    return bar


def categories(report: Page) -> list[str]:
    entries = menu(report).locator("div.p-3 li a").all_inner_texts()
    assert entries[: len(GENERAL)] == GENERAL
    return entries[len(GENERAL) :]


def show_results(report: Page, category: str):
    """Click on every result of a category; yields the path of the one that is shown."""
    bar = menu(report)
    bar.locator("li a").get_by_text(category, exact=True).click()
    # Results in pairs have one row and a switch, as still and moving pictures have.
    for switch in bar.locator("fieldset label").all() or [None]:
        if switch is not None:
            switch.click()
        for row in bar.locator("tbody tr").all():
            row.locator("a[iconname=eye]").click()
            yield report.evaluate("app.state.resultPath")


def contrast(shown: Locator | ElementHandle) -> float:
    """Standard deviation of what is seen of an element, in grey levels of 0-255."""
    picture = Image.open(io.BytesIO(shown.screenshot())).convert("L")
    return float(np.asarray(picture, dtype=float).std())


def check_figure(report: Page) -> None:
    figure = report.locator("#app img:not(nav img)")
    figure.evaluate("image => image.decode()")
    assert contrast(figure) > 1, "the figure is blank"
    check_scrolls_to_its_ends(figure)


def check_scrolls_to_its_ends(shown: Locator) -> None:
    seen = shown.evaluate(
        """box => {
          const pane = box.closest(".overflow-auto"), room = pane.getBoundingClientRect();
          pane.scrollTo(0, 0);
          const first = box.getBoundingClientRect();
          pane.scrollTo(pane.scrollWidth, pane.scrollHeight);
          const last = box.getBoundingClientRect();
          return { above: room.top - first.top, left: room.left - first.left,
                   below: last.bottom - room.bottom, right: last.right - room.right };
        }"""
    )
    hidden = {side: pixels for side, pixels in seen.items() if pixels > 0.5}
    assert not hidden, f"pixels that nobody can scroll to: {hidden}"


def check_page(report: Page) -> None:
    path = report.evaluate("app.state.resultPath")
    size = report.evaluate("path => atob(results[path].data_uri.split(',')[1]).length", path)
    assert size < PAGE_BYTES_MAX
    frame = report.locator("iframe").element_handle().content_frame()
    assert frame.url.startswith("data:text/html"), f"the frame is blocked: {frame.url[:100]}"
    frame.wait_for_load_state()
    assert frame.locator("body").inner_text().strip(), "the page is empty"
    wide = frame.evaluate(
        "[document.documentElement, ...document.querySelectorAll('.wide')]"
        ".map(box => box.scrollWidth - box.clientWidth)"
    )
    assert max(wide) <= 0, f"pixels by which the page or its tables are too wide: {wide}"
    for canvas in frame.locator("canvas").all():
        frame.wait_for_function("() => new Promise(done => requestAnimationFrame(() => done(1)))")
        assert contrast(canvas) > 1, "the canvas is blank"
    for image in frame.locator("img").all():
        image.evaluate("image => image.decode()")
    for table in frame.locator("table").all():
        check_table(frame, table)


def check_table(frame: Frame, table: Locator) -> None:
    """Sort by the first column of numbers, and filter where there is a field for it."""
    heading = table.locator("th.number").first
    if heading.count():
        values = heading.evaluate(
            """heading => new Promise((done, failed) => {
              setTimeout(() => failed(new Error("the table was not sorted")), 300000);
              const table = heading.closest("table");
              table.addEventListener("sort-end", () => done(
                [...table.tBodies[0].rows].map(row => row.cells[heading.cellIndex].dataset.sort)
              ));
              heading.click();
            })"""
        )
        numbers = [float(value) for value in values if value]
        assert numbers == sorted(numbers), f"not in order: {values}"
    field = table.locator("xpath=../preceding-sibling::*[1][self::input]")
    if field.count():
        rows = table.locator("tbody tr")
        first = rows.first.locator("td").first.inner_text()
        field.fill(first)
        shown = table.locator("tbody tr:visible").all_inner_texts()
        assert shown
        assert all(first.lower() in text.lower() for text in shown)
        field.fill("no row holds this")
        assert not table.locator("tbody tr:visible").count()
        field.fill("")
        assert table.locator("tbody tr:visible").count() == rows.count()


def test_every_result_is_seen_whole(report, subtests):
    seen = set()
    kinds = report.evaluate("Object.entries(results).map(([path, r]) => [path, r.mime_type])")
    check = {"text/html": check_page, "image/png": check_figure, "image/svg+xml": check_figure}
    for category in categories(report):
        for path in show_results(report, category):
            seen.add(path)
            with subtests.test(path):
                check[dict(kinds)[path]](report)
    assert seen == set(dict(kinds)), "results that no entry of the menu leads to"


def test_every_result_and_rule_is_described(report, subtests):
    bar = report.locator("nav.h-screen")
    rules = set()
    for path, caption, rule in report.evaluate(
        "Object.entries(results).map(([path, r]) => [path, r.caption, r.job_properties.rule])"
    ):
        with subtests.test(path):
            assert caption.strip(), "it has no caption"
            report.evaluate("path => app.showResultInfo(path)", path)
            bar.get_by_text("Description", exact=True).wait_for()
            if rule not in rules:
                rules.add(rule)
                bar.locator("a:has(svg)").last.click()
                bar.get_by_text("Code", exact=True).wait_for()


def test_the_front_page_shows_pictures_numbers_and_all_samples(report):
    menu(report)  # the house leads here, too
    front = report.locator("#app .prose")
    samples = front.locator(".sheet figure")
    names = set(report.evaluate("Object.values(results).map(r => r.labels.sample)")) - {None}
    assert samples.count() == len(names)
    assert front.locator(".shown img").count()
    assert front.locator(".numbers dt").count() == 12
    for picture in front.locator("img").all():
        picture.evaluate("image => image.decode()")
    check_scrolls_to_its_ends(front)


@pytest.mark.parametrize("page", ["Workflow", "Statistics"])
def test_general_pages_are_drawn(report, page):
    menu(report).get_by_text(page, exact=True).click()
    drawings = report.locator("#app canvas")
    drawings.first.wait_for()
    for drawing in drawings.all():
        assert contrast(drawing) > 1, "the canvas is blank"


def test_every_licence_is_shown(report):
    menu(report).get_by_text("About", exact=True).click()
    for entry in report.locator("nav.h-screen div.p-3 li a").all():
        entry.click()
        assert report.locator("#app pre").inner_text().strip()
