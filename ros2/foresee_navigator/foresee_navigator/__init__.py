"""ROS 2 nodes: the navigator for a robot, and a simulated robot to try it with.

`navigator_node` and `simulator_node` talk to ROS. All other modules are free of it: `settings`
(parameters), `scans` and `poses` (what arrives), `watchdog` (what does not), `pilot` and `forecast`
(what to do), `relay` (what to send while a decision is late), `maps` and `report` (what to
publish).
"""
