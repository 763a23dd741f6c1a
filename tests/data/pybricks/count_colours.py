# Drives about on a bright floor and counts how often it comes over something red, green or blue.
from random import randint
from threading import Thread
from pybricks.ev3devices import ColorSensor, Motor, UltrasonicSensor
from pybricks.hubs import EV3Brick
from pybricks.parameters import Color, Port
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait

ev3 = EV3Brick()
base = DriveBase(Motor(Port.A), Motor(Port.D), wheel_diameter=56, axle_track=114)
sonar = UltrasonicSensor(Port.S1)
eye = ColorSensor(Port.S3)
clock = StopWatch()
found = {Color.RED: 0, Color.GREEN: 0, Color.BLUE: 0}


def count():
    while True:
        for colour in found:
            ev3.screen.print(colour, found[colour])
        colour = eye.color()
        while colour not in found:
            wait(10)
            colour = eye.color()
        found[colour] += 1
        ev3.speaker.beep()
        while eye.color() != Color.WHITE:
            wait(10)


def is_blocked():
    return base.distance_control.stalled() or base.heading_control.stalled()


def drive(speed, turn_rate, there):
    base.reset()
    base.drive(speed, turn_rate)
    while not there() and not is_blocked() and clock.time() < 90000:
        wait(10)


Thread(target=count).start()
while clock.time() < 90000:
    drive(100, 0, lambda: sonar.distance() < 250)
    drive(-100, 0, lambda: base.distance() < -100)
    angle = randint(90, 150)
    drive(0, -60, lambda: base.angle() < -angle)
base.stop()
