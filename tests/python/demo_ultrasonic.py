"""Drives until something is near."""
from time import sleep

from ev3dev2.motor import OUTPUT_B, OUTPUT_C, MoveSteering
from ev3dev2.sensor.lego import UltrasonicSensor

pair = MoveSteering(OUTPUT_B, OUTPUT_C)
sonar = UltrasonicSensor()
sonar.mode = UltrasonicSensor.MODE_US_DIST_CM
pair.on(steering=0, speed=20)
while not 0 < sonar.distance_centimeters < 40:
    sleep(0.02)
pair.off()
print("done")
