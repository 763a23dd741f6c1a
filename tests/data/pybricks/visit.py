# Drives to a place and turns to a heading there; stops when the wheels are blocked.
from math import atan2, degrees, sqrt
from pybricks.ev3devices import Motor
from pybricks.hubs import EV3Brick
from pybricks.parameters import Port
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait

ev3 = EV3Brick()
base = DriveBase(Motor(Port.A), Motor(Port.D), wheel_diameter=56, axle_track=114)
clock = StopWatch()
x, y, facing = 800, -200, 90


def is_blocked():
    return base.distance_control.stalled() or base.heading_control.stalled()


def drive(speed, turn_rate, there):
    base.drive(speed, turn_rate)
    while not there():
        if is_blocked() or clock.time() > 120000:
            raise SystemExit
        wait(10)
    base.stop()


def turn_to(angle):
    sign = 1 if angle > base.angle() else -1
    drive(0, 60 * sign, lambda: sign * (angle - base.angle()) < 1)


turn_to(-degrees(atan2(y, x)))
drive(100, 0, lambda: base.distance() >= sqrt(x * x + y * y))
turn_to(-facing)
ev3.screen.print("at", x, y)
ev3.speaker.beep()
