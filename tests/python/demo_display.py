"""Draws a black bar on a white screen with words beside it, until enter is pressed."""
from time import sleep

from ev3dev2.button import Button
from ev3dev2.display import Display

screen, button = Display(), Button()
screen.clear()
screen.draw.rectangle((10, 20, 59, 39), fill="black")
screen.text_pixels("Hello", clear_screen=False, x=80, y=60)
screen.update()
print("ready", screen.xres, screen.yres, flush=True)
while not button.enter:
    sleep(0.02)
screen.clear()
screen.update()
print("done")
