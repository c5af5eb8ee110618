"""A run in pybullet's window, for test_window.py: window_run.py FRAMEBUFFER prints what it saw as JSON.

In the window a tendon without tension hangs beside one that is pulled. Then keys are pressed on the X server.
"""

import ctypes
import json
import os
import sys
import time
from threading import Thread

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

WIDTH, HEIGHT = 1024, 768
SPACE, RIGHT = 0x20, 0xFF53  # X11 keysyms


def screen(path: str) -> np.ndarray:
    """(height, width, 3) uint8 of the X server's frame buffer, an XWD file of 32 bits a pixel."""
    data = np.fromfile(path, np.uint8)
    head = data[:100].view(">u4")
    offset, colors = int(head[0]), int(head[19])
    width, height, stride = int(head[4]), int(head[5]), int(head[12])
    rows = data[offset + 12 * colors :][: height * stride].reshape(height, stride)
    return rows[:, : 4 * width].reshape(height, width, 4)[..., 2::-1]


def press(keysym: int) -> None:
    """Press and release a key, as a keyboard would, over the window."""
    x11, test = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXtst.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    display = ctypes.c_void_p(x11.XOpenDisplay(None))
    code = x11.XKeysymToKeycode(display, ctypes.c_ulong(keysym))
    test.XTestFakeMotionEvent(display, -1, WIDTH // 2, HEIGHT // 4, 0)
    for down in (1, 0):
        test.XTestFakeKeyEvent(display, code, down, 0)
        x11.XSync(display, 0)
        time.sleep(0.3)
    x11.XCloseDisplay(display)


def project(points) -> list:
    """(k, 2) columns and rows at which the window's camera sees points (k, 3)."""
    told = p.getDebugVisualizerCamera()
    both = np.reshape(told[3], (4, 4)).T @ np.reshape(told[2], (4, 4)).T
    clip = np.c_[points, np.ones(len(points))] @ both.T
    across, up = (clip[:, :2] / clip[:, 3:]).T
    return np.c_[(1 + across) / 2 * WIDTH, (1 - up) / 2 * HEIGHT].tolist()


def main(framebuffer: str) -> None:
    p.connect(p.GUI, options=f"--width={WIDTH} --height={HEIGHT}")
    p.configureDebugVisualizer(p.COV_ENABLE_GUI, 0)
    p.configureDebugVisualizer(p.COV_ENABLE_SHADOWS, 0)
    p.resetDebugVisualizerCamera(0.4, 0, 0, (0, 0, 0))
    world = bt.TendonWorld()
    material = bt.Material(stiffness=1e4, damping=1.0)
    slack = world.add_tendon([(-0.1, 0, 0.04), (0.1, 0, 0.04)], 0.006, material, 12)
    taut = world.add_tendon([(-0.1, 0, -0.04), (0.1, 0, -0.04)], 0.006, material, 12)
    for tendon, stretch in ((slack, 0.0), (taut, 0.006)):
        tendon.grip(0)
        tendon.grip(-1, target=tendon.positions[-1] + (stretch, 0, 0))
    window = view.Window(world, colors=[view.TENDON_COLOR])
    for _ in range(60):
        window.update()
        world.step()
    window.update()
    time.sleep(1.0)
    seen = screen(framebuffer)
    lines = {"slack": project(slack.positions), "taut": project(taut.positions)}
    pixels = {name: [seen[round(y), round(x)].tolist() for x, y in line] for name, line in lines.items()}
    beside = [seen[round(y) + 40, round(x)].tolist() for x, y in lines["taut"]]
    print(json.dumps({"pixels": pixels, "beside": beside, "steps": paused_steps(world, window)}))
    sys.stdout.flush()
    os._exit(0)  # pybullet's window prints while it closes


def wait_for(condition) -> None:
    """Until it is true, at most half a minute; and half a second more, for what must not happen."""
    end = time.monotonic() + 30
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    time.sleep(0.5)


def paused_steps(world, window) -> list[int]:
    """Steps taken: running, after space, after each of two single steps, and after space again."""
    steps, going = [0], [True]

    def run():
        while going[0] and window.update():
            world.step()
            steps[0] += 1
            time.sleep(0.01)

    thread = Thread(target=run, daemon=True)
    thread.start()
    wait_for(lambda: steps[0] >= 5)
    found = [steps[0]]
    for key, done in (
        (SPACE, lambda: window.paused),
        (RIGHT, lambda: steps[0] > found[-1]),
        (RIGHT, lambda: steps[0] > found[-1]),
        (SPACE, lambda: not window.paused and steps[0] >= found[-1] + 5),
    ):
        press(key)
        wait_for(done)
        found.append(steps[0])
    going[0] = False
    thread.join(5)
    return found


if __name__ == "__main__":
    main(sys.argv[1])
