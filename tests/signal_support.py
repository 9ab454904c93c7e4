"""What the tests of signals and of worker processes share."""

from __future__ import annotations

PATIENCE = 30.0  # s; what takes as long is stuck

SLOW_IMPORT = """
import sys, time
class Slow:
    def find_spec(self, name, path=None, target=None):
        if name == "casadi":
            print("ready", flush=True)
            time.sleep(120)
sys.meta_path.insert(0, Slow())
"""
