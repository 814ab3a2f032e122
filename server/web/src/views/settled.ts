/** A value once it stays the same for a while: what is typed is not sent letter by letter. */
import { useEffect, useState } from "preact/hooks";

export function useSettled<T>(value: T, milliseconds = 400): T {
  const [settled, setSettled] = useState(value);
  useEffect(() => {
    const timer = setTimeout(() => setSettled(value), milliseconds);
    return () => clearTimeout(timer);
  }, [value, milliseconds]);
  return settled;
}
