/** Faults of the simulated machine as words and wishes. */
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
  node_death: "A device falls silent",
  drop: "Its messages are lost",
  delay: "Its messages come late",
  corrupt: "Its messages are disturbed",
  duplicate_id: "A second device has its node-ID",
  emcy_storm: "It sends 2000 emergencies",
  freeze: "A value stands still",
  nan: "A value is no number",
  saturate: "A value stays at the end of its range",
  noise_burst: "A value is noisy",
  bias_step: "A value is off by a constant",
  bus_off: "The CAN interface is bus-off",
  sync_jitter: "SYNC comes late at random",
  clock_jump: "The bus's clock jumps by an hour",
  half_open: "The gateway is gone, its connections stay",
  slow_peer: "Everything comes late and in pieces",
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

/** A running fault in a line. */
export function leftOf(one: Broken): string {
  const device = one.node !== undefined ? `node ${one.node} on ${one.bus}` : `unit ${one.unit} on ${one.bus}`;
  const bus = one.node === undefined && one.unit === undefined ? one.bus : device;
  return `${faultWords(one.fault)} (${one.channel ?? bus}), ${Math.ceil(one.left_s)} s more`;
}
