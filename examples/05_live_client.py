"""Follow a run from another program, by JSON lines over TCP; any language can do the same.

In one terminal: taxelflow run rig:slide-and-turn --to jsonl-listen://127.0.0.1:7000
In another one:  python examples/05_live_client.py
"""

import json
import socket

with socket.create_connection(("127.0.0.1", 7000)) as connection:
    for line in connection.makefile():
        scan = json.loads(line)
        for event in scan["events"]:
            print(f"{event['t_s']:8.3f} s  {event['pad']}: {event['event']}")
        for name, pad in scan["pads"].items():
            if pad["slipping"] and pad["vx_m_s"] is not None:  # unknown is null
                print(f"{scan['t_s']:8.3f} s  {name}: {1e3 * pad['vx_m_s']:+.1f}, {1e3 * pad['vy_m_s']:+.1f} mm/s")
