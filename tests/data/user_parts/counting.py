"""A user detector that breaks the contract quietly: it draws random numbers and shares them between lanes."""

import random


class Counting:
    """random, and one for all"""

    id, level = "counting", "aircraft"
    inputs = ("q", "left_inner.rod")
    seen = 0

    def __init__(self, dt):
        pass

    def update(self, t, y):
        Counting.seen += 1
        return {"r": random.random() * abs(y.q) + abs(y.left_inner_rod)}
