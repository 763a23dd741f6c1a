"""Drives a square by counting rotations."""
from ev3dev2.motor import OUTPUT_B, OUTPUT_C, MoveSteering

pair = MoveSteering(OUTPUT_B, OUTPUT_C)
for _ in range(4):
    pair.on_for_seconds(steering=0, speed=25, seconds=1)
    pair.on_for_rotations(steering=-100, speed=10, rotations=0.475)
print("done")
