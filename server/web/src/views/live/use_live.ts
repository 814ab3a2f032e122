/** The live stream of a machine while a view shows it. */
import { useEffect, useRef, useState } from "preact/hooks";
import { API } from "../../net/client";
import { LiveSocket, type LinkState, type SocketLike } from "../../net/live_socket";
import { realTimers } from "../../net/timers";
import { useSession } from "../../session";
import { History } from "./history";
import { paced } from "./pace";

export interface Live {
  history: History;
  link: LinkState;
  reason: string;
  /** Counts what came; whoever draws draws again when it moves. */
  tick: number;
  /** Seconds since values came; Infinity before the first. */
  silence: number;
}

/** A browser's socket to the live stream; the token travels as a sub-protocol, as browsers send no headers here. */
function open(machine: string, token: string | null): SocketLike {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const url = `${scheme}//${location.host}${API}/live/stream?machine=${encodeURIComponent(machine)}`;
  return new WebSocket(url, token === null ? ["hilfit.v1"] : ["hilfit.v1", `bearer.${token}`]) as SocketLike;
}

export function useLive(machine: string | null): Live {
  const session = useSession();
  const history = useRef(new History());
  const [link, setLink] = useState<{ state: LinkState; reason: string }>({ state: "connecting", reason: "" });
  const [tick, setTick] = useState(0);
  const socket = useRef<LiveSocket | null>(null);
  const renewals = session.renewals.value;

  useEffect(() => {
    history.current = new History();
    if (machine === null) return undefined;
    let gone = false;
    const draw = paced(() => {
      if (!gone) setTick((count) => count + 1);
    });
    const live = new LiveSocket(
      () => open(machine, session.token()),
      {
        message: (message) => {
          history.current.take(message, Date.now());
          if (!document.hidden) draw();
        },
        state: (state, reason) => setLink({ state, reason }),
      },
      realTimers,
    );
    socket.current = live;
    live.start();
    const clock = setInterval(draw, 1000); // silence grows without messages
    return () => {
      gone = true;
      clearInterval(clock);
      live.stop();
      socket.current = null;
    };
  }, [machine, session]);
  const first = useRef(renewals);
  useEffect(() => {
    if (renewals !== first.current) socket.current?.renew("the service came back");
  }, [renewals]);

  const heard = history.current.heard;
  const silence = heard === null ? Infinity : Math.max(0, (Date.now() - heard) / 1000);
  return { history: history.current, link: link.state, reason: link.reason, tick, silence };
}
