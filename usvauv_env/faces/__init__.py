"""The world as environments of other libraries: Gymnasium (one mission or many), PettingZoo, TorchRL.

From outside: the environment classes of the three modules; `camera` draws for their `render`.
"""
