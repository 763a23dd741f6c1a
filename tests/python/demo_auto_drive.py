"""Drives about on its own until a button is pressed.

It backs away from what it bumps into, with a sound and red lights.
"""
from time import sleep

from ev3dev2.button import Button
from ev3dev2.led import Leds
from ev3dev2.motor import OUTPUT_B, OUTPUT_C, LargeMotor
from ev3dev2.sensor.lego import InfraredSensor, TouchSensor
from ev3dev2.sound import Sound

motors = [LargeMotor(port) for port in (OUTPUT_B, OUTPUT_C)]
infrared, touch, button, leds, sound = InfraredSensor(), TouchSensor(), Button(), Leds(), Sound()
backed = 0


def wait():
    while any(motor.state for motor in motors):
        sleep(0.05)


for motor in motors:
    motor.run_direct()
while not button.any():
    if touch.is_pressed:
        sound.tone([(1000, 100, 50)] * 2)
        leds.set_color("LEFT", "RED")
        leds.set_color("RIGHT", "RED")
        for motor in motors:
            motor.stop(stop_action="brake")
            motor.run_timed(speed_sp=-300, time_sp=700)
        wait()
        for motor, direction in zip(motors, (1, -1)):
            motor.run_timed(speed_sp=300 * direction, time_sp=600)
        wait()
        backed += 1
        print("backed", flush=True)
        for motor in motors:
            motor.run_direct()
    duty = 60 if infrared.proximity > 60 else 30
    for motor in motors:
        motor.duty_cycle_sp = duty
    sleep(0.05)
for motor in motors:
    motor.stop()
print("done", backed)
