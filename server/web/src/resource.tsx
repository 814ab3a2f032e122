/** A resource that stays up to date. */
import { useCallback, useEffect, useRef, useState } from "preact/hooks";
import { useSession } from "./session";

export interface Resource<T> {
  value: T | null;
  etag: string | null;
  error: string | null;
  loading: boolean;
  /** What is shown may be old: the service is away, or could not be read. */
  stale: boolean;
  reload(): void;
}

interface Held<T> {
  path: string | null;
  value: T | null;
  etag: string | null;
  error: string | null;
  loading: boolean;
  failed: boolean;
}

/** Milliseconds after which a reading that failed while the service seems to be there is tried again. */
const AGAIN_MS = 3000;
const NOTHING = { value: null, etag: null, error: null, failed: false };

/**
 * Read `path` (null: nothing), and again whenever the event stream says that one of `watch` moved, after sleep, and
 * when the service came back. The last value stays while the service is away, marked stale.
 */
export function useResource<T>(path: string | null, watch: string | string[]): Resource<T> {
  const session = useSession();
  const [held, setHeld] = useState<Held<T>>({ ...NOTHING, path, loading: path !== null });
  const wanted = useRef({ path, number: 0, busy: false, again: false });
  const names = typeof watch === "string" ? [watch] : watch;
  const revisions = session.revisions.value;
  const moved = names.map((name) => revisions[name] ?? 0).join(",");
  const renewals = session.renewals.value;
  const online = session.online.value;

  const read = useCallback(async (): Promise<void> => {
    const state = wanted.current;
    if (state.path === null) return;
    if (state.busy) {
      state.again = true; // what is under way may have been answered before the change
      return;
    }
    const { path: asked, number } = state;
    state.busy = true;
    setHeld((now) => ({ ...now, loading: true }));
    const outcome = await session.client.get<T>(asked);
    if (wanted.current.number !== number) return; // another path is wanted by now
    state.busy = false;
    if (outcome.kind === "done")
      setHeld({ path: asked, value: outcome.value, etag: outcome.etag, error: null, loading: false, failed: false });
    else if (outcome.kind === "refused" && [404, 409, 422].includes(outcome.status))
      setHeld({ ...NOTHING, path: asked, error: outcome.text, loading: false });
    else setHeld((now) => ({ ...now, error: outcome.text, loading: false, failed: true }));
    if (state.again) {
      state.again = false;
      void read();
    }
  }, [session]);

  useEffect(() => {
    wanted.current = { path, number: wanted.current.number + 1, busy: false, again: false };
    setHeld((now) => (now.path === path ? now : { ...NOTHING, path, loading: path !== null }));
    return () => {
      wanted.current.number += 1;
    };
  }, [path]);
  useEffect(() => void read(), [path, moved, renewals, read]);
  useEffect(() => {
    if (!held.failed || !online) return undefined;
    const timer = setTimeout(() => void read(), AGAIN_MS);
    return () => clearTimeout(timer);
  }, [held, online, read]);

  const shown = held.path === path ? held : { ...NOTHING, path, loading: path !== null };
  return {
    value: shown.value,
    etag: shown.etag,
    error: shown.error,
    loading: shown.loading,
    stale: shown.value !== null && (!online || shown.failed),
    reload: () => void read(),
  };
}

/** Read a resource again each `ms` milliseconds while the page is looked at: what changes without an event. */
export function useRegularly(resource: Resource<unknown>, ms: number): void {
  const latest = useRef(resource);
  latest.current = resource;
  useEffect(() => {
    const timer = setInterval(() => {
      if (!document.hidden) latest.current.reload();
    }, ms);
    return () => clearInterval(timer);
  }, [ms]);
}
