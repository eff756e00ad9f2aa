"""Functions of tensors that a CUDA device replays as one graph.

With small networks a GPU waits for Python, which launches some hundred kernels per update. A CUDA graph is launched as
a whole. It records addresses, so tensors that a function reads and writes besides its inputs must stay in place, and it
must neither wait for the device nor copy from the host (torch's notes on CUDA semantics, "CUDA graphs").
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import torch
from torch import Tensor

WARM_UP = 3  # ordinary calls before the recorded one, in which libraries and optimisers allocate their memory

Outputs = dict[str, Tensor]
# A recorded call: the tensors it reads, the graph that executes it, and the outputs, which the graph overwrites.
Recording = tuple[tuple[Tensor, ...], Callable[[], None], Outputs]


class Recorded:
    """A function of tensors of fixed shapes that returns tensors by name; on a CUDA device it is recorded and replayed.

    Elsewhere each call is a call of the function itself. Outputs belong to the caller. A function's work in Python,
    such as counting, is done only in calls that are not replayed.

    Args:
        function: the function.
        generators: the only ones from which it draws, on the device of its tensors; each replay draws anew.
    """

    def __init__(self, function: Callable[..., Outputs], *generators: torch.Generator) -> None:
        self._function = function
        self._generators = generators
        cuda = generators[0].device.type == "cuda" and torch.cuda.is_available()
        self._stream = torch.cuda.Stream(generators[0].device) if cuda else None
        self.forget()

    def forget(self) -> None:
        """Record anew, after tensors that the function uses were replaced."""
        self._calls: dict[int, int] = {}
        self._recordings: dict[int, Recording] = {}

    def __call__(self, *inputs: Tensor, variant: int = 0) -> Outputs:
        """Call the function; calls of one `variant` do the same operations."""
        if self._stream is None:
            return self._function(*inputs)
        self._calls[variant] = self._calls.get(variant, 0) + 1
        if self._calls[variant] <= WARM_UP:
            return self._call_as_recorded(self._stream, *inputs)
        if variant not in self._recordings:
            self._recordings[variant] = self._record(self._stream, *(value.clone() for value in inputs))
        held, replay, outputs = self._recordings[variant]
        for own, value in zip(held, inputs, strict=True):
            own.copy_(value)
        replay()
        return {name: value.clone() for name, value in outputs.items()}

    def _call_as_recorded(self, stream: torch.cuda.Stream, *inputs: Tensor) -> Outputs:
        """Call the function on the stream on which it is recorded."""
        current = torch.cuda.current_stream(stream.device)
        stream.wait_stream(current)
        with torch.cuda.stream(stream):
            outputs = self._function(*inputs)
        current.wait_stream(stream)
        return outputs

    def _record(self, stream: torch.cuda.Stream, *inputs: Tensor) -> Recording:
        graph = torch.cuda.CUDAGraph()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # later versions register generators themselves, and say so
            for generator in self._generators:
                graph.register_generator_state(generator)
        with torch.cuda.graph(graph, stream=stream):
            outputs = self._function(*inputs)
        return inputs, graph.replay, outputs
