"""A headless Chromium, driven over its debugging pipe (Chrome DevTools Protocol), without any library."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from typing import Any, Self

COMMAND = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
QUIET = (
    "--headless",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)
WAIT_S = 30.0
Message = dict[str, Any]


class Chromium:
    """A browser with one empty tab. A context manager; what the tab said meanwhile is in `heard`."""

    def __init__(self) -> None:
        self.heard: list[Message] = []
        self._profile = tempfile.TemporaryDirectory(prefix="viewsep-chromium-", ignore_cleanup_errors=True)
        self._sent = 0
        self._session = ""
        self._left = b""

    def __enter__(self) -> Self:
        assert COMMAND is not None
        to_read, self._to = os.pipe()
        self._from, to_write = os.pipe()

        def give() -> None:
            """The browser reads from 3 and writes to 4."""
            high = [os.dup(fd) for fd in (to_read, to_write)]
            for place, fd in enumerate(high, start=3):
                os.dup2(fd, place)

        as_root = ["--no-sandbox"] if os.geteuid() == 0 else []
        typed = [COMMAND, *QUIET, *as_root, f"--user-data-dir={self._profile.name}", "--remote-debugging-pipe"]
        self._process = subprocess.Popen(
            typed, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, close_fds=False, preexec_fn=give
        )
        os.close(to_read)
        os.close(to_write)
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._to)  # the browser ends when nobody can tell it anything
        try:
            self._process.wait(WAIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._from)
        self._profile.cleanup()

    def call(self, method: str, **parameters: Any) -> Message:
        """The browser's answer to a command. Fails when it refuses, or does not answer in time."""
        self._sent += 1
        number = self._sent
        command = {"id": number, "method": method, "params": parameters}
        command |= {"sessionId": self._session} if self._session else {}
        os.write(self._to, json.dumps(command).encode() + b"\0")
        answer = self._wait_for(lambda message: message.get("id") == number)
        assert "error" not in answer, f"{method}: {answer['error']}"
        result: Message = answer["result"]
        return result

    def open(self, address: str) -> None:
        """Open a page and wait until all of it is there."""
        self.heard.clear()
        self.call("Page.navigate", url=address)
        if not any(message["method"] == "Page.loadEventFired" for message in self.heard):
            self._wait_for(lambda message: message.get("method") == "Page.loadEventFired")

    def tell(self, expression: str) -> Any:
        """The value of an expression of the page's language; a promise's when it is kept."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def press(self, key: str) -> None:
        """A key that is no letter, such as ArrowLeft."""
        code = {"ArrowLeft": 37, "ArrowRight": 39, "Home": 36, "End": 35, "Tab": 9}[key]
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)

    def click(self, x: float, y: float) -> None:
        """The left button, at a place of the window."""
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def complaints(self) -> list[str]:
        """Errors and warnings that the page caused since it was opened."""
        self.tell("1")  # what was said before is heard by then
        said = []
        for message in self.heard:
            match message:
                case {"method": "Runtime.exceptionThrown", "params": {"exceptionDetails": details}}:
                    said.append(str(details))
                case {"method": "Log.entryAdded", "params": {"entry": {"level": "error" | "warning"} as entry}}:
                    said.append(entry["text"])
                case {"method": "Runtime.consoleAPICalled", "params": parameters}:
                    said.append(str(parameters["args"]))
        return said

    def requests(self) -> list[str]:
        """Addresses that were asked for since the page was opened, but for those that hold the thing itself."""
        asked = [m["params"]["request"]["url"] for m in self.heard if m["method"] == "Network.requestWillBeSent"]
        return [address for address in asked if not address.startswith("data:")]

    def _wait_for(self, wanted: Callable[[Message], bool]) -> Message:
        until = time.monotonic() + WAIT_S
        while True:
            message = self._next(until)
            if "method" in message:
                self.heard.append(message)
            if wanted(message):
                return message

    def _next(self, until: float) -> Message:
        while b"\0" not in self._left:
            ready, _, _ = select.select([self._from], [], [], max(0.0, until - time.monotonic()))
            assert ready, f"Chromium did not answer within {WAIT_S:g} s"
            read = os.read(self._from, 1 << 20)
            assert read, "Chromium has ended"
            self._left += read
        text, _, self._left = self._left.partition(b"\0")
        message: Message = json.loads(text)
        return message
