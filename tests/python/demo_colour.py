"""Says what colour it sees, until it is ended."""
from time import sleep

from ev3dev2.sensor.lego import ColorSensor
from ev3dev2.sound import Sound

eye, sound = ColorSensor(), Sound()
while True:
    sound.speak(ColorSensor.COLORS[eye.color])
    sleep(0.2)
