"""Colours on the status lights, then a flash, then as they were."""
from ev3dev2.led import Leds

leds = Leds()
for color in ("RED", "AMBER", "YELLOW", "ORANGE", "GREEN", "BLACK"):
    leds.set_color("LEFT", color)
    leds.set_color("RIGHT", color)
leds.animate_flash("AMBER", sleeptime=0.05, duration=0.3)
leds.set_color("LEFT", "RED")
leds.set_color("RIGHT", (0.5, 0.25))
print("done")
