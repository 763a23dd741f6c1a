# Follows the left edge of a dark line.
from pybricks.ev3devices import ColorSensor, Motor
from pybricks.parameters import Port
from pybricks.robotics import DriveBase
from pybricks.tools import wait

base = DriveBase(Motor(Port.A), Motor(Port.D), wheel_diameter=56, axle_track=114)
eye = ColorSensor(Port.S3)

while True:
    base.drive(60, -2.5 * (35 - eye.reflection()))
    wait(10)
