"""Signals as exceptions and as requests."""

import signal
import threading

import pytest

from usvauv.kernels.errors import UserError
from usvauv.kernels.interruption import SIGNALS, Interrupted, Interruption, deferred, in_thread, stoppable


@pytest.fixture
def interruption():
    """Signals raise `Interrupted` in this process."""
    before = {signum: signal.getsignal(signum) for signum in SIGNALS}
    handler = Interruption()
    handler.install()
    yield handler
    for signum, old in before.items():
        signal.signal(signum, old)


@pytest.mark.parametrize(("signum", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
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
        with stoppable() as stop, deferred():
            signal.raise_signal(signum)
        assert stop.asked


def test_a_signal_that_is_ignored_stays_ignored(interruption):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    interruption.install()
    with stoppable() as stop, deferred():
        signal.raise_signal(signal.SIGINT)
    assert not stop.asked
    stop.raise_if_asked()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_other_threads_get_no_signals(interruption):
    """There handlers cannot be set; a `Stop` can be asked all the same."""
    found = []

    def work():
        with stoppable() as stop, deferred():
            stop.ask(signal.SIGTERM)
        found.append(stop.signum)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [signal.SIGTERM]


def test_a_thread_reports_what_its_main_thread_does_not(capsys):
    for error, reported in (
        (ValueError("odd"), True),
        (OSError("full"), False),
        (UserError("wrong"), False),
        (Interrupted(2), False),
    ):
        in_thread(threading.ExceptHookArgs((type(error), error, None, threading.current_thread())))
        assert (type(error).__name__ in capsys.readouterr().err) == reported
