"""Ask for one page again and again until the standard input ends; print how long each answer took, s.

Run as a process of its own, so that the times are the server's and not those of the tests around it.
"""

from __future__ import annotations

import http.client
import json
import sys
import threading
import time

PAUSE = 0.25
"""Between two requests, s."""


def main(host: str, port: int, path: str) -> None:
    """Measure until the end; print a list of times, and one of answers that were wrong."""
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    times, wrong = [], []
    while not ended.wait(PAUSE):
        begin = time.perf_counter()
        connection = http.client.HTTPConnection(host, port, timeout=60)
        try:
            connection.request("GET", path)
            answer = connection.getresponse()
            text = answer.read().decode(errors="replace")
        except OSError as error:
            wrong.append(f"idle page: {error}")
            continue
        finally:
            times.append(time.perf_counter() - begin)
            connection.close()
        if answer.status != 200 or "This session has expired" in text:
            wrong.append(f"idle page: {answer.status}")
    print(json.dumps([times, wrong]))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
