"""A beep, a song, a recording and a word."""
import os
import struct
import tempfile
import wave

from ev3dev2.sound import Sound

sound = Sound()
sound.set_volume(40)
sound.beep()
sound.play_song((("D4", "e3"), ("G4", "q")))
with tempfile.TemporaryDirectory() as folder:
    path = os.path.join(folder, "tone.wav")
    with wave.open(path, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        # 800 Hz for half a second.
        samples = (9000 if n // 5 % 2 else -9000 for n in range(4000))
        file.writeframes(b"".join(struct.pack("<h", sample) for sample in samples))
    sound.play_file(path, volume=40)
sound.speak("I am a robot")
print("done")
