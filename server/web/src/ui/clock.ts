/** The time of this device, each second. */
import { useEffect, useState } from "preact/hooks";

/** ms since 1970; who calls it is drawn again each second. */
export function useSecond(): number {
  const [now, setNow] = useState(Date.now());
  useEffect(() => {
    const timer = setInterval(() => setNow(Date.now()), 1000);
    return () => clearInterval(timer);
  }, []);
  return now;
}
