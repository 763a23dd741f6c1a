"""The medium motor turns the head: by degrees, rotations and time; then inversed, and let go."""
from time import sleep

from ev3dev2.motor import OUTPUT_A, MediumMotor, SpeedDPS, SpeedPercent

head = MediumMotor(OUTPUT_A)
head.reset()
head.on_for_degrees(SpeedPercent(20), 180)
head.on_for_rotations(SpeedDPS(360), -1)
head.on_for_seconds(SpeedPercent(15), 0.5, brake=False)
head.wait_until_not_moving(timeout=2000)
head.polarity = head.POLARITY_INVERSED
head.on(SpeedPercent(10))
sleep(0.3)
head.off(brake=False)
print("done", head.position)
