"""A headless browser, spoken to by the WebDriver protocol (W3C), which needs no further package."""

import base64
import json
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request

NAMES = ("chromium", "chromium-browser", "google-chrome")
KEYS = {"left": "\ue012", "right": "\ue014", "home": "\ue011", "end": "\ue010", "shift": "\ue008"}
"""Key → its character in the protocol."""


def missing():
    """Why there is no browser here; "" if there is one."""
    if not any(map(shutil.which, NAMES)):
        return f"no browser is installed: none of {', '.join(NAMES)}"
    return "" if shutil.which("chromedriver") else "chromedriver is not installed"


class Browser:
    """A browser with one window of the given size [pixels]; `close` ends it."""

    def __init__(self, width=1200, height=1000):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._driver = subprocess.Popen(["chromedriver", f"--port={port}"], **quiet)
        self._at = f"http://127.0.0.1:{port}/session"
        words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        options = {
            "binary": next(filter(None, map(shutil.which, NAMES))),
            "args": [*words, f"--window-size={width},{height}"],
        }
        wanted = {
            "alwaysMatch": {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        }
        for _ in range(100):
            try:
                session = self._ask("", {"capabilities": wanted})
                break
            except urllib.error.URLError:
                time.sleep(0.1)
        self._at += f"/{session['sessionId']}"

    def _ask(self, path, body):
        data = json.dumps(body).encode()
        request = urllib.request.Request(
            self._at + path, data, {"Content-Type": "application/json"}
        )
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(json.load(error)["value"]["message"]) from None

    def open(self, address):
        self._ask("/url", {"url": address})

    def run(self, script, *arguments):
        """The value that JavaScript returns."""
        return self._ask("/execute/sync", {"script": script, "args": arguments})

    def wait(self, script, *arguments):
        """Wait until JavaScript returns something true, and return it."""
        for _ in range(600):
            if found := self.run(script, *arguments):
                return found
            time.sleep(0.05)
        raise AssertionError(f"never true: {script}")

    def press(self, *keys):
        """Press keys together; the last one is let go first."""
        codes = [KEYS.get(key, key) for key in keys]
        actions = [{"type": "keyDown", "value": code} for code in codes]
        actions += [{"type": "keyUp", "value": code} for code in reversed(codes)]
        self._ask("/actions", {"actions": [{"type": "key", "id": "keys", "actions": actions}]})

    def errors(self):
        """The errors in the console since it was last asked for."""
        entries = self._ask("/se/log", {"type": "browser"})
        return [entry["message"] for entry in entries if entry["level"] == "SEVERE"]

    def picture(self, path):
        """Save a screenshot of the window as a PNG file."""
        with urllib.request.urlopen(f"{self._at}/screenshot", timeout=60) as answer:
            path.write_bytes(base64.b64decode(json.load(answer)["value"]))

    def close(self):
        """End the browser."""
        request = urllib.request.Request(self._at, method="DELETE")
        urllib.request.urlopen(request, timeout=60).close()
        self._driver.terminate()
        self._driver.wait()
