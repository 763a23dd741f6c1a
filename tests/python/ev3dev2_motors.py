"""One motor at a time, in every way that python-ev3dev2 documents; prints the results."""
import json
import time
from ev3dev2 import DeviceNotFound
from ev3dev2.motor import (OUTPUT_A, OUTPUT_C, LargeMotor, MediumMotor, SpeedDPS, SpeedNativeUnits,
                          SpeedPercent, SpeedRPM, SpeedRPS,
                           list_motors)

said = {"motors": sorted([motor.address, motor.driver_name] for motor in list_motors())}
try:
    LargeMotor(OUTPUT_C)
except DeviceNotFound as error:
    said["nothing_in_c"] = str(error)

motor = MediumMotor()
said["found"] = [
    motor.address, motor.count_per_rot, motor.max_speed, motor.commands, motor.stop_actions,
    motor.polarity,
]


def timed(action):
    start = time.time()
    answer = action()
    return [motor.position, time.time() - start, answer]


motor.reset()
said["degrees"] = timed(lambda: motor.on_for_degrees(SpeedPercent(30), 90))
said["rotations_back"] = timed(lambda: motor.on_for_rotations(SpeedRPM(-30), 0.5))
said["seconds"] = timed(lambda: motor.on_for_seconds(SpeedDPS(180), 1.0))
said["to_position"] = timed(lambda: motor.on_to_position(SpeedRPS(0.5), 0))
said["holding"] = motor.state

# Without blocking: a poll on the state is what ends these.
motor.on_for_seconds(SpeedNativeUnits(200), 0.5, block=False)
said["wait_running"] = motor.wait_until("running", timeout=500)
said["wait_end"] = timed(motor.wait_until_not_moving)
motor.on(SpeedPercent(20))
said["wait_too_long"] = timed(lambda: motor.wait_while("running", timeout=300))
said["speed"] = motor.speed
motor.off(brake=False)
said["wait_off"] = timed(lambda: motor.wait_while("running", timeout=1000))
said["off"] = motor.state

motor.stop_action = "brake"
motor.run_direct(duty_cycle_sp=40)
time.sleep(0.4)
motor.duty_cycle_sp = -40
time.sleep(0.1)
said["duty"] = motor.duty_cycle
motor.stop()
time.sleep(0.3)

motor.ramp_up_sp = 1500
motor.run_forever(speed_sp=800)
time.sleep(0.3)
said["ramping"] = [motor.is_ramping, motor.speed]
motor.stop()
motor.ramp_up_sp = 0
try:
    motor.run_forever(speed_sp=motor.max_speed + 1)
except ValueError as error:
    said["too_fast"] = str(error)
motor.polarity = "inversed"
motor.position = 0
motor.on_for_degrees(SpeedPercent(30), 45)
said["inversed"] = motor.position
motor.reset()
said["reset"] = [motor.polarity, motor.position, motor.state]
print(json.dumps(said))
