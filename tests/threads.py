"""Calls in several threads at once, which take turns as often as the interpreter lets them."""

import sys
import threading


def at_once(run, count):
    """run(k) for k in range(count), each in a thread of its own; returns when all have."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=run, args=(k,)) for k in range(count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
