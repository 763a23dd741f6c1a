"""Drives until it touches a wall, and backs off."""
from ev3dev2.motor import OUTPUT_B, OUTPUT_C, MoveSteering
from ev3dev2.sensor.lego import TouchSensor

pair = MoveSteering(OUTPUT_B, OUTPUT_C)
touch = TouchSensor()
pair.on(steering=0, speed=30)
touch.wait_for_pressed()
pair.off()
pair.on_for_seconds(steering=0, speed=-20, seconds=1)
print("done")
