"""Drives a square and turns by the gyro."""
from ev3dev2.motor import OUTPUT_B, OUTPUT_C, MoveSteering
from ev3dev2.sensor.lego import GyroSensor

pair = MoveSteering(OUTPUT_B, OUTPUT_C)
gyro = GyroSensor()
gyro.mode = GyroSensor.MODE_GYRO_ANG
for _ in range(4):
    pair.on_for_seconds(steering=0, speed=25, seconds=1)
    pair.on(steering=-100, speed=5)
    gyro.wait_until_angle_changed_by(90)
    pair.off()
print("done")
