"""A headless Chromium by its debugging pipe: opens a file, waits, looks and listens. Needs no package."""

import base64
import fcntl
import json
import os
import select
import shutil
import struct
import subprocess
import tempfile
import time
import zlib

import numpy as np

EXECUTABLE = shutil.which("chromium") or shutil.which("chromium-browser")
_FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe",
    "--hide-scrollbars",
]
_PATIENCE = 120.0  # seconds for one answer


class Browser:
    """One page; requests: the addresses that it has asked for."""

    def __init__(self, width: int, height: int):
        self._folder = tempfile.mkdtemp()
        commands, answers = os.pipe(), os.pipe()
        ours = [fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 20) for fd in (commands[1], answers[0])]
        theirs = [fcntl.fcntl(fd, fcntl.F_DUPFD, 20) for fd in (commands[0], answers[1])]
        for fd in (*commands, *answers):
            os.close(fd)
        size = f"--window-size={width},{height}"
        redirect = f'exec 3<&{theirs[0]} 4>&{theirs[1]}; exec "$0" "$@"'
        command = ["/bin/bash", "-c", redirect, EXECUTABLE, *_FLAGS, f"--user-data-dir={self._folder}", size]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen([*command, "about:blank"], pass_fds=theirs, **quiet)
        for fd in theirs:
            os.close(fd)
        self._write, self._read = ours
        self._rest, self._number, self._session = b"", 0, None
        self.requests: list[str] = []
        self.errors: list[str] = []
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Network", "Page", "Runtime"):
            self.call(f"{domain}.enable")
        shape = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **shape)

    def call(self, method: str, **parameters) -> dict:
        """The result of a command of the DevTools protocol."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]

    def open(self, address: str, ready: str) -> None:
        """Go to an address and wait until the expression `ready` is true there."""
        self.call("Page.navigate", url=address)
        end = time.monotonic() + _PATIENCE
        while not self.value(f"!!({ready})"):
            if time.monotonic() > end:
                raise TimeoutError(f"{ready}; errors of the page: {self.errors}")
            time.sleep(0.1)

    def value(self, expression: str):
        """What an expression (or the promise of one) gives in the page."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise RuntimeError(json.dumps(found["exceptionDetails"])[:500])
        return found["result"].get("value")

    def screenshot(self) -> np.ndarray:
        """(height, width, 3) uint8 of the window."""
        return decoded_png(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._write), os.close(self._read)
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _next(self) -> dict:
        """The next answer or event; events are kept where they matter."""
        end = time.monotonic() + _PATIENCE
        while b"\0" not in self._rest:
            if not select.select([self._read], [], [], max(0.0, end - time.monotonic()))[0]:
                raise TimeoutError("no answer from the browser")
            found = os.read(self._read, 1 << 20)
            if not found:
                raise RuntimeError("the browser has gone")
            self._rest += found
        text, _, self._rest = self._rest.partition(b"\0")
        event = json.loads(text)
        if event.get("method") == "Network.requestWillBeSent":
            self.requests.append(event["params"]["request"]["url"])
        if event.get("method") == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(event["params"]["exceptionDetails"])[:500])
        return event


def decoded_png(data: bytes) -> np.ndarray:
    """(height, width, 3) uint8 of a PNG file with 8 bits for each of three or four channels."""
    at, packed = 8, b""
    while at < len(data):
        (length,), kind = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8]
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, depth, color = struct.unpack(">IIBB", body[:10])
            assert depth == 8 and color in (2, 6)
        packed += body if kind == b"IDAT" else b""
        at += 12 + length
    channels = {2: 3, 6: 4}[color]
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + width * channels)
    above = np.zeros(width * channels, np.uint8)
    image = np.zeros((height, width * channels), np.uint8)
    for k, row in enumerate(rows):
        above = image[k] = _unfiltered(int(row[0]), row[1:].copy(), above, channels)
    return image.reshape(height, width, channels)[..., :3]


def _unfiltered(kind: int, row, above, step: int) -> np.ndarray:
    """A row of a PNG image (section 9 of its specification)."""
    if kind == 0:
        return row
    if kind == 2:
        return row + above
    if kind == 1:
        return np.cumsum(row.reshape(-1, step), axis=0, dtype=np.uint8).ravel()
    line, up = row.astype(int).tolist(), above.astype(int).tolist()
    for k in range(len(line)):
        left, corner = (line[k - step], up[k - step]) if k >= step else (0, 0)
        if kind == 3:
            line[k] = (line[k] + (left + up[k]) // 2) & 255
            continue
        guess = left + up[k] - corner
        away = abs(guess - left), abs(guess - up[k]), abs(guess - corner)
        nearest = (left, up[k], corner)[away.index(min(away))]
        line[k] = (line[k] + nearest) & 255
    return np.array(line, np.uint8)
