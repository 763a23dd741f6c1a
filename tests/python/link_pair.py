"""Pairs a PC with a brick whose pairing window is open, with nothing but pyzmq.

The protocol is in the documentation of `onbrick::link::pairing`.

    python3 link_pair.py ADDRESS NAME OWN_PUBLIC_KEY OWN_SECRET_KEY

It shows the code and reads `yes` from its input if the brick shows the same; then it prints the
brick's name and key.
"""
import hashlib, json, re, secrets, sys, time, zmq
from zmq.utils import z85

address, name, public_key, secret_key = sys.argv[1:5]
window = zmq.Context.instance().socket(zmq.REQ)
window.curve_serverkey = b"w>il{Sx3&-W+P8nSMoe)b)!kpu3Q#g>4CE<ttSWd"
window.curve_publickey, window.curve_secretkey = public_key.encode(), secret_key.encode()
window.rcvtimeo, window.linger = 10_000, 0
window.connect(f"tcp://{address}:5671")

def ask(step, **fields):
    window.send_json({"version": 1, "id": 1, "op": "pair", "step": step, **fields})
    reply = json.loads(window.recv())
    return reply["ok"] if "ok" in reply else sys.exit(ascii(reply["error"]["message"]))

def sha256(*parts):
    return hashlib.sha256(b"".join(parts)).digest()

own, number = z85.decode(public_key), secrets.token_bytes(32)
commitment = sha256(b"onbrick pairing 1 commit", b"P", own, number).hex()
committed = ask("commit", name=name, commit=commitment)["commit"]
brick = ask("reveal", number=number.hex())
key, theirs = z85.decode(brick["key"]), bytes.fromhex(brick["number"])
if sha256(b"onbrick pairing 1 commit", b"B", key, theirs).hex() != committed:
    sys.exit("the brick showed another key or number than it had committed to")
if not re.fullmatch("[A-Za-z0-9][A-Za-z0-9._-]{0,63}", brick["name"], re.ASCII):
    sys.exit("the brick's name is none")
digest = sha256(b"onbrick pairing 1 code", own, key, number, theirs)
code = int.from_bytes(digest[:8], "big") % 1_000_000
print(f"{code // 1000:03} {code % 1000:03}", flush=True)
same = sys.stdin.readline().strip() == "yes"
said = ask("answer", same=same)
while same and said["step"] == "waits":
    time.sleep(0.5)
    said = ask("how")
if not same or said["step"] != "paired":
    sys.exit("not paired")
print(brick["name"], brick["key"])
