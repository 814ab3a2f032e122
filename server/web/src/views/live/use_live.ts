/** The live stream of a machine while a view shows it. */
import { type ReadonlySignal, useSignal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { API } from "../../net/client";
import { LiveSocket, type LinkState, type SocketLike } from "../../net/live_socket";
import { realTimers } from "../../net/timers";
import { useSession } from "../../session";
import { History } from "./history";
import { paced } from "./pace";
import { SILENT_S } from "./quality";

export interface Live {
  history: History;
  link: LinkState;
  reason: string;
  /** Counts what came: who shows values reads it, and is drawn again when it moves. Nobody else is. */
  ticks: ReadonlySignal<number>;
  /** Seconds since values came; Infinity before the first. */
  silence: number;
}

/** Seconds since values came. */
export function silenceOf(history: History): number {
  return history.heard === null ? Infinity : Math.max(0, (Date.now() - history.heard) / 1000);
}

/** What of a stream more than numbers depends on: whoever shows the stream is drawn again when it is another. */
function stateOf(history: History): string {
  const silence = silenceOf(history);
  const silent = silence < SILENT_S ? "" : Math.floor(silence);
  return `${history.acquisition} ${history.readings.size} ${silent}`;
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
  const ticks = useSignal(0);
  const [, setState] = useState("");
  const socket = useRef<LiveSocket | null>(null);
  const renewals = session.renewals.value;

  useEffect(() => {
    history.current = new History();
    if (machine === null) return undefined;
    let gone = false;
    const draw = paced(() => {
      if (gone) return;
      ticks.value += 1;
      setState(stateOf(history.current));
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

  const silence = silenceOf(history.current);
  return { history: history.current, link: link.state, reason: link.reason, ticks, silence };
}
