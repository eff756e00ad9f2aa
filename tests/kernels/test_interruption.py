"""Signals as exceptions and as requests."""

import signal

import pytest

from kernels.interruption import SIGNALS, Interrupted, Interruption, deferred, stoppable


@pytest.fixture
def interruption():
    """Signals raise `Interrupted` in this process."""
    before = {signum: signal.getsignal(signum) for signum in SIGNALS}
    handler = Interruption()
    handler.install()
    yield handler
    for signum, old in before.items():
        signal.signal(signum, old)


@pytest.mark.parametrize(("signum", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
class TestSignal:
    def test_raises_what_a_shell_reports(self, interruption, signum, code):
        with pytest.raises(Interrupted) as caught:
            signal.raise_signal(signum)
        assert caught.value.exit_code == code
        signal.raise_signal(signum)  # cleaning up is not disturbed

    def test_asks_once_then_raises(self, interruption, signum, code):
        asked = []
        with stoppable(lambda: asked.append(1)) as stop:
            signal.raise_signal(signum)
            assert (stop.asked, asked) == (True, [1])
            with pytest.raises(Interrupted):
                signal.raise_signal(signum)
        with pytest.raises(Interrupted) as caught:
            stop.raise_if_asked()
        assert caught.value.signum == signum

    def test_waits_for_what_would_not_survive_it(self, interruption, signum, code):
        done = []

        def work():
            with deferred():
                signal.raise_signal(signum)
                done.append(1)
            done.append(2)

        with pytest.raises(Interrupted):
            work()
        assert done == [1]

    def test_waits_and_then_asks(self, interruption, signum, code):
        with stoppable() as stop, deferred():
            signal.raise_signal(signum)
        assert stop.asked


@pytest.mark.parametrize("block", [stoppable, deferred])
def test_signals_act_as_before_after_the_block(interruption, block):
    with block():
        pass
    with pytest.raises(Interrupted):
        signal.raise_signal(signal.SIGINT)


def test_sigterm_without_a_handler_keeps_ending_the_process():
    before = signal.getsignal(signal.SIGTERM)
    assert before == signal.SIG_DFL
    with stoppable():
        assert signal.getsignal(signal.SIGTERM) is before
