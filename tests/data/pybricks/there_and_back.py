# Drives about for a minute, and then drives back to where it began.
from math import atan2, cos, degrees, radians, sin, sqrt
from random import randint
from pybricks.ev3devices import GyroSensor, Motor, UltrasonicSensor
from pybricks.hubs import EV3Brick
from pybricks.parameters import Color, Port
from pybricks.robotics import DriveBase
from pybricks.tools import StopWatch, wait

ev3 = EV3Brick()
base = DriveBase(Motor(Port.A), Motor(Port.D), wheel_diameter=56, axle_track=114)
gyro = GyroSensor(Port.S2)
sonar = UltrasonicSensor(Port.S1)
clock = StopWatch()
x = y = way = 0


def is_blocked():
    return base.distance_control.stalled() or base.heading_control.stalled()


def drive(speed, turn_rate, there):
    global x, y, way
    base.drive(speed, turn_rate)
    while not there() and not is_blocked() and clock.time() < 300000:
        wait(10)
        step = base.distance() - way
        way += step
        x += step * cos(radians(gyro.angle()))
        y -= step * sin(radians(gyro.angle()))


def turn(angle):
    goal, sign = gyro.angle() + angle, 1 if angle > 0 else -1
    drive(0, 60 * sign, lambda: sign * (goal - gyro.angle()) < 1)


def turn_away():
    start = way
    drive(-100, 0, lambda: way < start - 100)
    turn(-randint(90, 150))


def home_mm():
    return sqrt(x * x + y * y)


ev3.light.on(Color.GREEN)
ev3.screen.print("driving about")
while clock.time() < 60000:
    drive(100, 0, lambda: sonar.distance() < 250 or clock.time() > 60000)
    turn_away()
ev3.light.on(Color.ORANGE)
ev3.screen.print(home_mm(), "mm from home")
while home_mm() > 20 and clock.time() < 300000:
    angle = degrees(atan2(y, -x)) - gyro.angle()
    turn((angle + 180) % 360 - 180)
    start, far = way, home_mm()
    drive(100, 0, lambda: way > start + far or sonar.distance() < 200)
    if home_mm() > 20:
        turn_away()
        start = way
        drive(100, 0, lambda: way > start + 300 or sonar.distance() < 200)
turn(-gyro.angle())
base.stop()
ev3.screen.print("home again")
ev3.speaker.beep()
