"""A simulated bus for a test: `cargo xtask sim` as a user would start it."""

import os
import pathlib
import queue
import shutil
import signal
import subprocess
import tempfile
import threading

ROOT = pathlib.Path(__file__).resolve().parents[2]

# The first start may have to build images and simulator.
START_S = 900
STOP_S = 10


def xtask(*words):
    """The command line of one xtask command."""
    return [os.environ.get("CARGO", "cargo"), "xtask", *words]


class Bus:
    """A running scenario; `port` is the path that clients open."""

    def __init__(self, scenario, *options):
        self.folder = tempfile.mkdtemp(prefix="multidrop-")
        self.port = os.path.join(self.folder, "bus")
        self.process = subprocess.Popen(
            xtask("sim", scenario, "--link", self.port, *options),
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._lines = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self._await_ready()
        except Exception:
            self.process.kill()
            self.remove()
            raise

    def _read(self):
        for line in self.process.stdout:
            self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def _await_ready(self):
        while True:
            line = self._lines.get(timeout=START_S)
            if line is None:
                raise RuntimeError(f"sim ended with {self.process.wait()} before it was ready")
            if line == f"ready: {self.port}":
                return

    def stop(self, with_signal=signal.SIGTERM):
        """Ends the bus; gives its exit code and whether the link was left behind."""
        if self.process.poll() is None:
            self.process.send_signal(with_signal)
        return self.ended(STOP_S)

    def ended(self, timeout_s):
        """Waits for the end; gives the exit code and whether the link was left behind."""
        try:
            code = self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise
        finally:
            left_behind = os.path.lexists(self.port)
            self._reader.join()
            self.process.stdout.close()
            self.remove()
        return code, left_behind

    def remove(self):
        """Removes the folder of the link."""
        shutil.rmtree(self.folder, ignore_errors=True)
