"""Operations of a schedule's rows, by number; cosim/flight/loop/schedule_kernel.py says what each does."""

CLOCK, COPY, ADD, TRUTH, NOISE, STEP, KEEP, SCATTER, GET, PUT, SCALE = range(11)
WIDTH = 8  # whole numbers of a row
