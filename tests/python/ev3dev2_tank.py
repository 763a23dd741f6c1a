"""Drives with MoveTank and MoveSteering as python-ev3dev2 documents; prints the motors' reports."""
import json
import time
from ev3dev2.motor import OUTPUT_B, OUTPUT_D, MoveSteering, MoveTank, SpeedDPS, SpeedPercent

WHEEL_MM, TRACK_MM = 188.976, 114.3

tank = MoveTank(OUTPUT_B, OUTPUT_D)
steering = MoveSteering(OUTPUT_B, OUTPUT_D)


def positions():
    # A motor that holds is pulled back to its target.
    time.sleep(0.3)
    return [tank.left_motor.position, tank.right_motor.position]


said = {"start": positions()}

# Two turns of the wheels ahead.
tank.on_for_rotations(SpeedPercent(40), SpeedPercent(40), 2)
said["ahead"] = positions()

# A quarter turn to the right on the spot: as far as the wheels roll on a quarter of the circle
# between them.
quarter_deg = 360 * (3.141592653589793 * TRACK_MM / 4) / WHEEL_MM
steering.on_for_degrees(steering=100, speed=SpeedPercent(25), degrees=quarter_deg)
said["turned"] = positions()

# One second at one turn a second.
tank.on_for_seconds(SpeedDPS(360), SpeedDPS(360), 1)
said["timed"] = positions()

# One more turn of the wheels, straight.
steering.on_for_rotations(steering=0, speed=SpeedPercent(30), rotations=1)
said["end"] = positions()
said["holding"] = [tank.left_motor.is_holding, tank.right_motor.is_holding]
tank.off(brake=False)
said["state"] = [tank.left_motor.state, tank.right_motor.state]
print(json.dumps(said))
