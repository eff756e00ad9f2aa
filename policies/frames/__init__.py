"""Frames: conversion between a world's observations and actions and a network's.

The world's observation and action are in world axes, in which a network has to learn every heading separately. In the
target's frame x′ points from the AUV to its target and y′ to the left of it, and an action is a course relative to that
bearing and a speed, so that "straight to the target" is a constant. The bearing and the AUV's own position are among
the features, so no information is lost.

Public: `frames`, the classes by name, and the classes; `Frame`, `TargetFrame` and `OffsetFrame` are bases of a new one.
"""

from usvauv.kernels.registry import Registry
from usvauv.policies.frames.frame import Frame, WorldFrame
from usvauv.policies.frames.offsets import CirclingFrame, FinsFrame, OffsetFrame, PassingFrame
from usvauv.policies.frames.rudder import RudderFrame
from usvauv.policies.frames.target import GuidedFrame, TargetFrame
from usvauv.policies.names import PolicyError

frames: Registry[type[Frame]] = Registry("frame", PolicyError, Frame)
frames.register("guided", GuidedFrame)
frames.register("target", TargetFrame)
frames.register("world", WorldFrame)
frames.register("passing", PassingFrame)
frames.register("circling", CirclingFrame)
frames.register("rudder", RudderFrame)
frames.register("fins", FinsFrame)

__all__ = [
    "CirclingFrame",
    "FinsFrame",
    "Frame",
    "GuidedFrame",
    "OffsetFrame",
    "PassingFrame",
    "RudderFrame",
    "TargetFrame",
    "WorldFrame",
    "frames",
]
