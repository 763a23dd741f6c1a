"""The infrared sensor: proximity, the beacon, the remote control."""
import json
import time
from ev3dev2.sensor.lego import InfraredSensor

SETTLE_S = 0.3

eye = InfraredSensor()


def settled(read):
    read()
    time.sleep(SETTLE_S)
    return read()


said = {"address": eye.address, "modes": {}}
for mode in eye.modes:
    eye.mode = mode
    time.sleep(SETTLE_S)
    values = [eye.value(index) for index in range(eye.num_values)]
    said["modes"][mode] = [values, eye.units, eye.bin_data_format]
said["proximity"] = settled(lambda: eye.proximity)
said["heading"] = settled(lambda: eye.heading(channel=2))
said["distance"] = eye.distance(channel=2)
said["no_beacon"] = eye.heading_and_distance(channel=1)
said["buttons"] = settled(lambda: eye.buttons_pressed(channel=1))
said["top_left"] = eye.top_left(channel=1)
said["bottom_left"] = eye.bottom_left(channel=1)
said["other_channel"] = eye.buttons_pressed(channel=3)
print(json.dumps(said))
