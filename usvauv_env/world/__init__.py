"""The batched world: `world.World` and the kernels bound to it (`mission_kernels`); the layout of observations and
actions (`observation_layout`), the boat's strategy (`strategy_choice`), spaces and boats as agents (`agents`), shapes,
memory and bounds of the state (`state`), the numbers that the kernels read (`mission_parameters`, `boat_speed`,
`message_parameters`, `current_statistics`), and checks of what can occur at sea (`regime`).

Public: `World`, `Step` and `ObservationLayout`.
"""
