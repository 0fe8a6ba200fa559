"""User detectors that do what no detector does, for tests: which one is chosen by the parameter `how`."""

import os
import sys
import time


class Mute(Exception):
    """an exception that cannot even be told"""

    def __str__(self):
        return 1 / 0


class Muter(BaseException):
    """an exception that cannot be told, and is none that `except Exception` meets"""

    def __str__(self):
        raise Muter


class Misbehaving:
    """does what it must not, from one second on"""

    id, level, technologies = "misbehaving", "local", ("hydraulic",)
    inputs = ("rod", "surface")

    made = 0

    def __init__(self, dt, how=0.0):
        self.how = int(how)
        Misbehaving.made += 1
        self.second = Misbehaving.made % 2 == 0

    def update(self, t, y):
        r = abs(y.rod - 0.3 * y.surface) / 0.02
        if t < 1.0:
            return {"r": r}
        if self.how == 1:
            raise ZeroDivisionError("on purpose")
        if self.how == 2:
            return {"r": float("nan"), "alarm": True}
        if self.how == 3:
            return {"r": r, "verdict": "gremlins"}
        if self.how == 4:
            return "an alarm"
        if self.how == 5:
            y.rod = 0.0
        if self.how == 6 and t < 1.01:  # a replay, which drops nothing, goes through every step
            time.sleep(0.15)
        if self.how == 7:
            sys.exit(3)
        if self.how == 8:
            return {"r": r, "alarm": "perhaps"}
        if self.how == 11:
            raise GeneratorExit("on purpose")
        if self.how == 12:
            raise Mute
        if self.how == 14:
            raise Muter
        if self.how == 13:
            return {"r": [r, r]}
        if self.how == 10 and self.second:
            return {"r": r / 0.0}
        if self.how == 9:
            os.environ.get("HOME")
            while True:
                pass
        return {"r": r}
