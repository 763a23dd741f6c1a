"""Drives a tank: ahead, an arc, and back."""
from ev3dev2.motor import OUTPUT_B, OUTPUT_C, MoveTank, SpeedPercent

tank = MoveTank(OUTPUT_B, OUTPUT_C)
tank.on_for_rotations(SpeedPercent(30), SpeedPercent(30), 1.5)
tank.on_for_rotations(SpeedPercent(30), SpeedPercent(15), 1)
tank.on_for_seconds(SpeedPercent(-20), SpeedPercent(-20), 1)
print("done")
