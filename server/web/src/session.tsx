/** What every view has at hand: the session, resources that stay up to date, commands that are sent once. */
import { createContext } from "preact";
import { useContext } from "preact/hooks";
import type { Session } from "./net/connection";

export type { MachineSummary, Principal, Scope, Session } from "./net/connection";
export { useResource, type Resource } from "./resource";
export { useCommand, CommandNotice, type CommandState } from "./command";

export const SessionContext = createContext<Session | null>(null);

export function useSession(): Session {
  const session = useContext(SessionContext);
  if (session === null) throw new Error("useSession outside of the page");
  return session;
}
