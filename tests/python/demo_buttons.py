"""Waits for a bump of enter, then tells what changes until back is pressed."""
from time import sleep

from ev3dev2.button import Button

button = Button()
print("ready", flush=True)
print("bump", button.wait_for_bump("enter", 60000), flush=True)
seen = []
button.on_change = lambda changes: seen.extend(changes)
while ("backspace", True) not in seen:
    button.process()
    sleep(0.01)
print("done", seen)
