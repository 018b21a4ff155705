"""The viewer in a browser: hover, clicks that name and exclude, run again, point of view; nothing asked of others."""

import shutil

import browser
import pytest
from viewing import viewing

from windmark.pipeline.project import read_project

pytestmark = [browser.needed, pytest.mark.slow]

DONE = "document.documentElement?.dataset.view === 'run {}' && document.documentElement.dataset.ready === 'yes'"
WORDS = "document.querySelector('.wm-pov-words').textContent"


@pytest.fixture(scope="module")
def folder(virtual_test, tmp_path_factory):
    out = tmp_path_factory.mktemp("viewed")
    for path in virtual_test[0].iterdir():
        if path.is_file():
            shutil.copy(path, out)
    return out


@pytest.fixture(scope="module")
def opened(folder, tmp_path_factory):
    """The page, from before its first run is done on, and who serves it."""
    with viewing(folder / "project.toml", run=False) as client:
        client.session.start(write=False)
        with browser.opened(tmp_path_factory.mktemp("browser"), 1280, 1000) as tab:
            tab.open(client.server.address)
            tab.until(DONE.format(1), 300)
            yield tab, client


def entry(folder, name):
    return next(i for i in read_project(folder / "project.toml").image if i.label == name)


def test_pictures_spots_and_model_are_there(opened):
    page, client = opened
    assert page.wrong() == []
    assert page.js("document.querySelectorAll('.wm-scene.wm-ready').length") == 1
    result = client.session.shown.result
    counts = page.js("[...document.querySelectorAll('.wm-view')].map((v) => [v.dataset.image, "
                     "v.querySelectorAll('circle[data-spot]').length])")  # fmt: skip
    assert dict(counts) == {i.name: len(i.detections) for i in result.images}
    notes = page.js("document.querySelector('circle[data-spot]').textContent")
    assert "merit" in notes
    assert "sigma" in notes


def test_rejected_candidates_are_shown_with_their_reasons(opened):
    page, _ = opened
    page.click(".wm-explain")
    page.until("document.querySelectorAll('.rejected circle').length > 10")
    assert "merit" in page.js("document.querySelector('.rejected circle title').textContent")
    page.click(".wm-explain")
    assert page.js("getComputedStyle(document.querySelector('.rejected')).display") == "none"


def test_spots_are_reached_by_keyboard(opened):
    page, _ = opened
    place = "(() => { const c = document.activeElement; return ['cx', 'cy'].map((k) => Number(c.getAttribute(k))); })()"
    page.js("document.querySelector('.wm-zoom').focus()")
    page.key("ArrowRight")
    first = page.js(place)
    assert page.js("document.activeElement.matches('circle[data-spot]')")
    page.key("ArrowRight")
    right = page.js(place)
    assert right[0] > first[0]
    page.key("ArrowDown")
    below = page.js(place)
    assert below[1] > right[1]
    for _ in range(200):  # as far as there are spots to the left
        before = page.js(place)
        page.key("ArrowLeft")
        if page.js(place) == before:
            break
        assert page.js(place)[0] < before[0]
    assert page.js("document.activeElement.matches('circle[data-spot]')")
    words = page.js("document.activeElement.getAttribute('aria-label')")
    page.key("Enter")
    assert page.js("document.querySelector('.wm-what').textContent") == words
    page.key("Escape")
    assert page.js("!document.querySelector('.wm-pop')")
    assert page.js(place) == before
    assert page.wrong() == []


def test_sliders_and_boxes_move_the_grid(opened):
    page, _ = opened
    page.js("document.querySelector('.wm-pov').open = true")
    page.until("!!document.querySelector('.live')")
    first = page.js("document.querySelector('.live').getAttribute('d')")
    assert page.js(f"parseFloat({WORDS}.split('·')[2])") < 0.1
    x, y = page.centre(".wm-sliders label:nth-child(3) input[type=range]")
    page.drag((x, y), (x + 20, y))
    page.until(f"document.querySelector('.live').getAttribute('d') !== {first!r}")
    page.until(f"parseFloat({WORDS}.split('·')[2]) > 1")
    page.js("(() => { const box = document.querySelectorAll('.wm-sliders input[type=number]')[6]; box.value = '400';"
            " box.dispatchEvent(new Event('input')); })()")  # fmt: skip
    page.until(f"{WORDS}.includes('fov must be')")
    page.click(".wm-home")
    page.until(f"parseFloat({WORDS}.split('·')[2]) < 0.1")
    assert page.js("document.querySelector('.live').getAttribute('d')") == first
    page.js("document.querySelector('.wm-pov').open = false")
    page.until("!document.querySelector('.live')")
    # The answer that was refused is the only thing that the browser has to say.
    assert [said for said in page.wrong() if "422" not in said] == []


def test_a_click_names_another_excludes_and_a_run_again_says_what_changed(opened, folder):
    page, client = opened
    view = page.js("document.querySelector('.wm-view').dataset.image")
    before = (folder / "project.toml").read_text()
    page.click(".wm-view circle.matched")
    name = page.js("document.querySelector('.wm-pop input').value")
    assert name in page.js("document.querySelector('.wm-what').textContent")
    page.js("document.querySelector('.wm-pop input').value = 'nobody'")
    page.click(".wm-pop form button")
    page.until("document.querySelector('.wm-pop .bad').textContent.includes('nobody')")
    assert (folder / "project.toml").read_text() == before
    page.js(f"document.querySelector('.wm-pop input').value = {name!r}")
    page.click(".wm-pop form button")
    page.until("!!document.querySelector('circle.told')")
    assert list(entry(folder, view).labels) == [name]
    # Its line of sight is in the other picture.
    page.click("circle.told")
    page.click(".wm-sight")
    page.until("document.querySelectorAll('.wm-view .sight').length === 1")
    assert page.js("document.querySelector('.sight').closest('.wm-view').dataset.image") != view
    # Another marker takes no part.
    page.js("document.querySelectorAll('.wm-view circle.matched')[1].id = 'second'")
    other = page.js("document.getElementById('second').textContent").split(":")[0]
    page.click("#second")
    page.click(".wm-exclude")
    page.until("!!document.querySelector('circle.excluded')")
    assert len(entry(folder, view).exclude) == 1
    assert page.js("document.querySelectorAll('.wm-edits li').length") == 2
    page.click(".wm-run")
    page.until(DONE.format(2), 300)
    changed = page.js("document.querySelector('.wm-changed').textContent")
    assert f"gone: {other}" in changed
    assert (folder / "results" / "report.html").exists()
    assert page.js("document.querySelectorAll('circle.told').length") == 1
    assert page.js("document.querySelectorAll('.wm-edits li').length") == 0
    page.click("circle.excluded")
    page.click(".wm-free")
    page.until("!document.querySelector('circle.excluded')")
    assert entry(folder, view).exclude == ()
    assert [said for said in page.wrong() if "422" not in said] == []
    assert client.session.problem == ""
