"""Drives with MoveDifferential and its odometry as python-ev3dev2 documents; prints its pose."""
import json
import math
from ev3dev2.motor import OUTPUT_B, OUTPUT_D, MoveDifferential, SpeedRPM
from ev3dev2.wheel import Wheel


class SeedWheel(Wheel):
    """The wheel that rolls 188.976 mm in a turn."""

    def __init__(self):
        Wheel.__init__(self, 188.976 / math.pi, 20)


mdiff = MoveDifferential(OUTPUT_B, OUTPUT_D, SeedWheel, 114.3)
mdiff.odometry_start(theta_degrees_start=0)
said = {}


def note(name):
    said[name] = [mdiff.x_pos_mm, mdiff.y_pos_mm, math.degrees(mdiff.theta)]


mdiff.on_for_distance(SpeedRPM(40), 300)
note("ahead")
mdiff.turn_left(SpeedRPM(30), 90)
note("left")
# A quarter of a circle of 250 mm, clockwise.
mdiff.on_arc_right(SpeedRPM(50), 250, math.pi / 2 * 250)
note("arc")
mdiff.turn_right(SpeedRPM(30), 90)
note("right")
mdiff.on_to_coordinates(SpeedRPM(40), 200, 0)
note("there")
mdiff.turn_to_angle(SpeedRPM(30), 0)
note("end")
mdiff.odometry_stop()
mdiff.off()
print(json.dumps(said))
