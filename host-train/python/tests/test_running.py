"""Threads, the interpreter's lock, progress, Ctrl-C and memory."""

import gc
import signal
import threading
import time

import numpy as np
import pytest

import elunardtm
from elunardtm import Model


@pytest.fixture(scope="module")
def large():
    return elunardtm.example(1000, 1000, 3)


def test_the_lock_is_released(large):
    turns, done = [0], threading.Event()

    def count():
        while not done.is_set():
            turns[0] += 1
            time.sleep(0.001)

    other = threading.Thread(target=count)
    other.start()
    start = time.monotonic()
    Model.load("ground").predict(large.image, large.coarse, **large.place, threads=1)
    seconds = time.monotonic() - start
    done.set()
    other.join()
    # Without the lock it gets a turn in every millisecond or so.
    assert turns[0] > 50 * seconds, (turns, seconds)


def test_calls_in_threads_agree(scene):
    model, found = Model.load("ground"), {}
    expected = model.predict(scene.image, scene.coarse, **scene.place).heights.tobytes()

    def run(k):
        found[k] = model.predict(scene.image, scene.coarse, **scene.place, threads=1 + k % 2).heights.tobytes()

    threads = [threading.Thread(target=run, args=(k,)) for k in range(4)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert set(found.values()) == {expected} and len(found) == 4


def test_progress_counts_tiles_to_the_end(scene):
    heard = []
    Model.load("nano").predict(scene.image, scene.coarse, **scene.place, progress=lambda done, all: heard.append((done, all)))
    assert heard[-1][0] == heard[-1][1] > 0
    elunardtm.hillshade(scene.truth, pixel_size=2.0, progress=lambda done, all: heard.append((done, all)))
    assert heard[-1] == (300, 300)


def test_an_exception_of_progress_stops_the_call(large):
    class Enough(Exception):
        pass

    def stop(done, all):
        if done:
            raise Enough

    start = time.monotonic()
    with pytest.raises(Enough):
        Model.load("ground").predict(large.image, large.coarse, **large.place, threads=1, progress=stop)
    assert time.monotonic() - start < 10
    assert Model.load("nano").predict(large.image[:64, :64], large.coarse, **large.place).valid.all(), "the next call runs"


def test_ctrl_c_stops_the_call_and_leaves_the_handler(large):
    # A shell's background job ignores Ctrl-C, and so would Python.
    handler = signal.default_int_handler
    before = signal.signal(signal.SIGINT, handler)
    timer = threading.Timer(0.3, lambda: signal.raise_signal(signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        for _ in range(50):
            Model.load("ground").predict(large.image, large.coarse, **large.place, threads=1)
    timer.join()
    assert signal.getsignal(signal.SIGINT) is handler
    signal.signal(signal.SIGINT, before)
    assert Model.load("nano").predict(large.image[:64, :64], large.coarse, **large.place).valid.all()


def test_repeated_calls_keep_no_memory(scene):
    model = Model.load("nano")

    def resident():
        gc.collect()
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096

    def call():
        shade = elunardtm.hillshade(np.tile(scene.truth, (3, 3)), pixel_size=2.0)
        assert model.predict(scene.image, scene.coarse, **scene.place).heights.shape == scene.image.shape
        return shade

    for _ in range(3):
        call()
    before = resident()
    for _ in range(10):
        call()
    # A kept copy of the arrays would be 60 MB.
    assert resident() - before < 25e6
