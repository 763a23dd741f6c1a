"""A PC asks a brick with nothing but pyzmq: its state, its missions, and a recording.

    python3 link_client.py ADDRESS BRICK_KEY OWN_PUBLIC_KEY OWN_SECRET_KEY [RUN FILE]
"""
import hashlib, json, sys, time, zmq

address, brick_key, public_key, secret_key = sys.argv[1:5]
brick = zmq.Context.instance().socket(zmq.REQ)
brick.curve_serverkey = brick_key.encode()
brick.curve_publickey = public_key.encode()
brick.curve_secretkey = secret_key.encode()
brick.rcvtimeo, brick.linger = 10_000, 0
brick.connect(f"tcp://{address}:5670")

def ask(op, **fields):
    brick.send_json({"version": 1, "id": 1, "op": op, **fields})
    reply, *data = brick.recv_multipart()
    reply = json.loads(reply)
    return (reply["ok"], *data) if "ok" in reply else sys.exit(reply["error"]["message"])

status = ask("status")[0]
missions = ask("missions")[0]["missions"]
print(status["brick"], status["state"], [mission["name"] for mission in missions])
if sys.argv[5:]:
    run, file = sys.argv[5:7]
    with open(file, "wb+") as recording:
        while True:
            part, data = ask("fetch", run=run, offset=recording.tell(), length=65536)
            recording.write(data)
            if part["sha256"] and recording.tell() == part["total"]:
                break
            if not data:
                time.sleep(0.2)
        recording.seek(0)
        sha256 = hashlib.sha256(recording.read()).hexdigest()
    if sha256 != part["sha256"]:
        sys.exit("what came is not what the brick has")
    ask("fetch", run=run, offset=part["total"], length=0, sha256=sha256)
    print(recording.name, part["total"])
