"""The brick itself: lights, battery, buttons, what the speaker lacks.

A person presses Enter and Left while it runs.
"""
import json
import time
from ev3dev2 import get_current_platform
from ev3dev2.button import Button
from ev3dev2.led import Leds
from ev3dev2.port import LegoPort
from ev3dev2.power import PowerSupply

said = {"platform": get_current_platform()}

power = PowerSupply()
said["battery"] = [
    power.measured_volts, power.measured_amps, power.max_voltage, power.min_voltage,
    power.technology, power.type,
]

leds = Leds()


def lights():
    return {name: led.brightness for name, led in leds.leds.items()}


said["lights_at_first"] = lights()
for colour in ("RED", "AMBER", "ORANGE"):
    leds.set_color("LEFT", colour)
    said[colour] = lights()
leds.set("RIGHT", brightness_pct=0.5)
said["half"] = lights()
red = leds.leds["red_left"]
red.trigger = "timer"
red.delay_on = 200
red.delay_off = 100
said["timer"] = [red.delay_on, red.delay_off, "heartbeat" in red.triggers]
leds.all_off()
said["all_off"] = lights()
leds.reset()
said["reset"] = lights()

port = LegoPort("ev3-ports:outC")
said["port"] = [port.address, port.driver_name, port.mode, port.status, port.modes]

button = Button()
seen = []
button.on_enter = lambda down: seen.append(["enter", down])
button.on_left = lambda down: seen.append(["left", down])
said["pressed_at_first"] = button.buttons_pressed
print("ready", flush=True)
end = time.time() + 10
while len(seen) < 4 and time.time() < end:
    button.process()
    time.sleep(0.01)
said["buttons"] = seen
print(json.dumps(said))
