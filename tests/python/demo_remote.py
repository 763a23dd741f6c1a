"""Drives by the infrared remote until a button is pressed; lights show the direction."""
from time import sleep

from ev3dev2.button import Button
from ev3dev2.led import Leds
from ev3dev2.motor import OUTPUT_B, OUTPUT_C, LargeMotor
from ev3dev2.sensor.lego import InfraredSensor

left, right = LargeMotor(OUTPUT_B), LargeMotor(OUTPUT_C)
remote, button, leds = InfraredSensor(), Button(), Leds()
leds.all_off()


def roll(motor, group, direction):
    def handler(pressed):
        if pressed:
            motor.run_forever(speed_sp=300 * direction)
            leds.set_color(group, "GREEN" if direction > 0 else "RED")
        else:
            motor.stop(stop_action="brake")
            leds.all_off()

    return handler


remote.on_channel1_top_left = roll(left, "LEFT", 1)
remote.on_channel1_bottom_left = roll(left, "LEFT", -1)
remote.on_channel1_top_right = roll(right, "RIGHT", 1)
remote.on_channel1_bottom_right = roll(right, "RIGHT", -1)
print("ready", flush=True)
while not button.any():
    remote.process()
    sleep(0.01)
left.stop()
right.stop()
print("done")
