/** The session, which every view has at hand. */
import { createContext } from "preact";
import { useContext } from "preact/hooks";
import type { Session } from "./net/connection";

export type { MachineSummary, Principal, Scope, Session } from "./net/connection";

export const SessionContext = createContext<Session | null>(null);

export function useSession(): Session {
  const session = useContext(SessionContext);
  if (session === null) throw new Error("useSession outside of the page");
  return session;
}
