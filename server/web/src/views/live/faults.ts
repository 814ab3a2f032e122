/** Faults of the simulated machine as words and wishes. */
import { t } from "../../texts";

export interface Offer {
  fault: string;
  target: string;
  entry: Record<string, unknown>;
}

/** A fault that lasts: keys of a fault file, and the seconds until it is over. */
export interface Broken {
  fault: string;
  left_s: number;
  bus?: string;
  node?: number;
  unit?: number;
  channel?: string;
}

const WORDS: Record<string, string> = {
  node_death: t("live.deviceFallsSilent"),
  drop: t("live.itsMessagesLost"),
  delay: t("live.itsMessagesComeLate"),
  corrupt: t("live.itsMessagesDisturbed"),
  duplicate_id: t("live.secondDeviceHasIts"),
  emcy_storm: t("live.sends2000Emergencies"),
  freeze: t("live.valueStandsStill"),
  nan: t("live.valueNoNumber"),
  saturate: t("live.valueStaysAtEnd"),
  noise_burst: t("live.valueNoisy"),
  bias_step: t("live.valueOffConstant"),
  bus_off: t("live.canInterfaceBusOff"),
  sync_jitter: t("live.syncComesLateAt"),
  clock_jump: t("live.bussClockJumpsHour"),
  half_open: t("live.gatewayGoneItsConnections"),
  slow_peer: t("live.everythingComesLatePieces"),
};

export const faultWords = (fault: string): string => WORDS[fault] ?? fault;

/** Offers by fault, both in the order in which they came. */
export function grouped(offers: Offer[]): Map<string, Offer[]> {
  const found = new Map<string, Offer[]>();
  for (const offer of offers) found.set(offer.fault, [...(found.get(offer.fault) ?? []), offer]);
  return found;
}

/** What to order: the offer from now on for so long; null if that is no length of time. */
export function asked(offer: Offer, seconds: string, longest: number): Record<string, unknown> | null {
  const long = Number(seconds.trim().replace(",", "."));
  if (seconds.trim() === "" || !Number.isFinite(long) || long <= 0 || long > longest) return null;
  return { ...offer.entry, at: 0, for: long };
}

/** What a fault is of, in words; `named` are channels behind it, in brackets as the service has them. */
function placeOf(one: Partial<Broken>, named = ""): string {
  if (one.channel !== undefined) return one.channel;
  const bus = one.bus ?? "";
  if (one.node !== undefined) return t("live.nodeOn", { node: one.node, bus }) + named;
  if (one.unit !== undefined) return t("live.unitOn", { unit: one.unit, bus }) + named;
  return bus;
}

/** What an offer is of. */
export function targetWords(offer: Offer): string {
  return placeOf(offer.entry, / \(.*\)$/.exec(offer.target)?.[0]) || offer.target;
}

/** A running fault in a line. */
export function leftOf(one: Broken): string {
  return t("live.sMore", {
    fault: faultWords(one.fault),
    channel: placeOf(one),
    leftS: Math.ceil(one.left_s),
  });
}
