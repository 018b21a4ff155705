"""A headless Chromium, driven over its own pipe: no package, no port, no network.

`Page` opens a file, moves the mouse, takes pictures, prints, and keeps what the page did wrong: errors on the console,
exceptions, requests to anywhere but the page itself.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--no-first-run", "--disable-extensions", "--disable-background-networking", "--disable-component-update",
    "--hide-scrollbars", "--force-color-profile=srgb", "--remote-debugging-pipe",
)  # fmt: skip
LIMIT_S = 120.0


def found():
    """The browser's program; None without."""
    given = os.environ.get("WINDMARK_BROWSER")
    return given or next(filter(None, map(shutil.which, NAMES)), None)


needed = pytest.mark.skipif(
    found() is None, reason="no Chromium here: install it (apt-get install chromium) to try pages in a browser"
)


class Browser:
    """The process and its pipe: commands out, answers and events in."""

    def __init__(self, folder):
        to_it, ours = os.pipe()
        from_it, its = os.pipe()
        # It reads from file descriptor 3 and writes to 4.
        words = ["bash", "-c", 'exec "$@" 3<&"$R" 4>&"$W"', "bash", found(), *FLAGS, f"--user-data-dir={folder}"]
        self.process = subprocess.Popen(
            words, env={**os.environ, "R": str(to_it), "W": str(its)}, pass_fds=(to_it, its),
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(to_it)
        os.close(its)
        self.out, self.into = from_it, ours
        self.number, self.rest, self.events = 0, b"", []

    def close(self):
        try:
            self.send("Browser.close")
            self.process.wait(30)
        except (RuntimeError, OSError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait(30)
        os.close(self.out)
        os.close(self.into)

    def send(self, method, session=None, **arguments):
        """A command and its answer; events that come meanwhile are kept."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": arguments}
        if session:
            message["sessionId"] = session
        os.write(self.into, json.dumps(message).encode() + b"\0")
        mine = self.number
        end = time.monotonic() + LIMIT_S
        while time.monotonic() < end:
            got = self._receive(end - time.monotonic())
            if got.get("id") == mine:
                if "error" in got:
                    raise RuntimeError(f"{method}: {got['error']}")
                return got["result"]
            self.events.append(got)
        raise TimeoutError(method)

    def listen(self, seconds):
        """Take events in for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            try:
                self.events.append(self._receive(left))
            except TimeoutError:
                return

    def _receive(self, seconds):
        end = time.monotonic() + seconds
        while b"\0" not in self.rest:
            left = end - time.monotonic()
            if left <= 0 or not select.select([self.out], [], [], left)[0]:
                raise TimeoutError("the browser does not answer")
            chunk = os.read(self.out, 1 << 20)
            if not chunk:
                raise RuntimeError("the browser has ended")
            self.rest += chunk
        one, self.rest = self.rest.split(b"\0", 1)
        return json.loads(one)


class Page:
    """One tab."""

    def __init__(self, browser, width=1280, height=900):
        self.browser = browser
        target = browser.send("Target.createTarget", url="about:blank")["targetId"]
        self.session = browser.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        self.size(width, height)

    def send(self, method, **arguments):
        return self.browser.send(method, self.session, **arguments)

    def size(self, width, height):
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def dark(self, on):
        value = "dark" if on else "light"
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": value}])

    def open(self, where):
        """Open a file or an address and wait until the page says that it is ready."""
        self.browser.events.clear()
        self.address = where if str(where).startswith("http") else Path(where).resolve().as_uri()
        self.send("Page.navigate", url=self.address)
        self.until("document.documentElement?.dataset.ready === 'yes'")
        return self

    def until(self, condition, seconds=60):
        end = time.monotonic() + seconds
        while not self._holds(condition):
            if time.monotonic() > end:
                raise TimeoutError(f"never came true: {condition}; the page said {self.wrong()}")
            self.browser.listen(0.1)

    def _holds(self, condition):
        """Whether it does; not yet in a page that is just making place for the next one."""
        try:
            return self.js(condition)
        except RuntimeError as error:
            if "navigated or closed" not in str(error):
                raise
            return False

    def js(self, words):
        """The value of an expression in the page; promises are waited for."""
        got = self.send("Runtime.evaluate", expression=words, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in got:
            raise RuntimeError(got["exceptionDetails"].get("exception", got["exceptionDetails"]))
        return got["result"].get("value")

    def settle(self):
        """Wait until what was changed is drawn."""
        self.js("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))")

    def centre(self, selector):
        """Middle of an element in the window, after it was scrolled there."""
        box = self.js(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            " e.scrollIntoView({block: 'center'});"
            " const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        self.settle()
        return box

    def mouse(self, kind, x, y, **more):
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def click(self, selector):
        x, y = self.centre(selector)
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, x, y, button="left", buttons=1 if kind == "mousePressed" else 0, clickCount=1)
        self.settle()

    def drag(self, start, end, **more):
        self.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
        for k in range(1, 5):
            at = [a + (b - a) * k / 4 for a, b in zip(start, end, strict=True)]
            self.mouse("mouseMoved", *at, button="left", buttons=1)
        self.mouse("mouseReleased", *end, button="left", buttons=0, clickCount=1)
        self.settle()

    def key(self, name, text=""):
        self.send("Input.dispatchKeyEvent", type="keyDown", key=name, text=text)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=name)
        self.settle()

    def shot(self, path=None, clip=None, whole=False):
        """A picture of the window as PNG."""
        more = {}
        if clip:
            more["clip"] = {**dict(zip(("x", "y", "width", "height"), clip, strict=True)), "scale": 1}
        content = base64.b64decode(self.send("Page.captureScreenshot", captureBeyondViewport=whole, **more)["data"])
        if path:
            Path(path).write_bytes(content)
        return content

    def pdf(self, path):
        """The page printed on A4."""
        got = self.send("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
        Path(path).write_bytes(base64.b64decode(got["data"]))
        return path

    def wrong(self):
        """What the page did that it must not: errors, and requests to other places than itself."""
        said = []
        for event in [e for e in self.browser.events if e.get("sessionId") == self.session]:
            method, what = event["method"], event.get("params", {})
            if method == "Runtime.exceptionThrown":
                said.append(str(what["exceptionDetails"].get("exception", {}).get("description", what)))
            elif method == "Runtime.consoleAPICalled" and what["type"] in ("error", "warning", "assert"):
                said.append(f"console {what['type']}: {[a.get('value', a.get('description')) for a in what['args']]}")
            elif method == "Log.entryAdded" and what["entry"]["level"] == "error":
                said.append(f"log: {what['entry']['text']} {what['entry'].get('url', '')}")
            elif method == "Network.requestWillBeSent" and not self.own(what["request"]["url"]):
                said.append(f"request to {what['request']['url']}")
        return said

    def own(self, url):
        """Whether an address is the page's own: itself, its data, or, of a server, anything there."""
        if url.startswith(("data:", "blob:", "about:")):
            return True
        return url.split("#")[0] == self.address.split("#")[0] or (
            self.address.startswith("http") and url.split("/")[:3] == self.address.split("/")[:3]
        )


@contextmanager
def opened(folder, width=1280, height=900):
    """A page of a browser of its own."""
    browser = Browser(folder)
    try:
        yield Page(browser, width, height)
    finally:
        browser.close()
