"""Functions of tensors that a CUDA device replays as one graph.

Small networks keep a GPU waiting for Python, which launches some hundred kernels an update. A CUDA graph is launched as
a whole. Recorded are the addresses of tensors, so what a function reads and writes besides its inputs must stay where
it is, and it must neither wait for the device nor copy from the host (torch's notes on CUDA semantics, "CUDA graphs").
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

WARM_UP = 3  # calls as they are before the recorded one, in which libraries and optimisers allocate what they keep

Outputs = dict[str, Tensor]
Function = Callable[..., Outputs]


class Recorder(Protocol):
    """What `Recorded` needs of a device that records."""

    def run(self, function: Callable[[], Outputs]) -> Outputs:
        """Call a function as recording will, without recording."""
        ...

    def record(self, function: Callable[[], Outputs]) -> tuple[Callable[[], None], Outputs]:
        """Record a call without executing it; returns what executes it, and the outputs, which that overwrites."""
        ...


class CudaRecorder:
    """Records with `torch.cuda.graph` on a stream of its own.

    Args:
        generators: on the device, from which recorded functions draw; each replay draws anew.
    """

    def __init__(self, *generators: torch.Generator) -> None:
        self._generators = generators
        self._device = generators[0].device
        self._stream = torch.cuda.Stream(self._device)

    def run(self, function: Callable[[], Outputs]) -> Outputs:
        current = torch.cuda.current_stream(self._device)
        self._stream.wait_stream(current)
        with torch.cuda.stream(self._stream):
            outputs = function()
        current.wait_stream(self._stream)
        return outputs

    def record(self, function: Callable[[], Outputs]) -> tuple[Callable[[], None], Outputs]:
        graph = torch.cuda.CUDAGraph()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # later versions register generators themselves, and say so
            for generator in self._generators:
                graph.register_generator_state(generator)
        with torch.cuda.graph(graph, stream=self._stream):
            outputs = function()
        return graph.replay, outputs


@dataclass(frozen=True)
class Recording:
    """A recorded call: the tensors it reads and writes, and what executes it."""

    inputs: tuple[Tensor, ...]
    replay: Callable[[], None]
    outputs: Outputs


class Recorded:
    """A function of tensors of fixed shapes that returns tensors by name; on a CUDA device it is recorded and replayed.

    Elsewhere each call is one of the function itself. Outputs belong to the caller. What a function does in Python,
    such as counting, happens at the calls that are not replayed.

    Args:
        function: to call.
        recorder: of the device; None: nothing is recorded.
    """

    def __init__(self, function: Function, recorder: Recorder | None) -> None:
        self._function = function
        self._recorder = recorder
        self.forget()

    @classmethod
    def on(cls, generator: torch.Generator, function: Function, *others: torch.Generator) -> Recorded:
        """A function whose tensors lie on the device of the generator; it draws from it and the others alone."""
        cuda = generator.device.type == "cuda" and torch.cuda.is_available()
        return cls(function, CudaRecorder(generator, *others) if cuda else None)

    def forget(self) -> None:
        """Record anew, after tensors that the function uses were replaced."""
        self._calls: dict[int, int] = {}
        self._recordings: dict[int, Recording] = {}

    def __call__(self, *inputs: Tensor, variant: int = 0) -> Outputs:
        """Call the function; calls of one `variant` do the same operations."""
        if self._recorder is None:
            return self._function(*inputs)
        self._calls[variant] = self._calls.get(variant, 0) + 1
        if self._calls[variant] <= WARM_UP:
            return self._recorder.run(lambda: self._function(*inputs))
        recording = self._recordings.get(variant)
        if recording is None:
            own = tuple(value.clone() for value in inputs)
            recording = Recording(own, *self._recorder.record(lambda: self._function(*own)))
            self._recordings[variant] = recording
        for held, value in zip(recording.inputs, inputs, strict=True):
            held.copy_(value)
        recording.replay()
        return {name: value.clone() for name, value in recording.outputs.items()}
