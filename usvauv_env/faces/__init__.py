"""The world as environments of Gymnasium (one mission or many), PettingZoo, TorchRL and Stable-Baselines3.

From outside: the environment classes of the modules.
"""
