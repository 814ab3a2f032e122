/** A text with line numbers; a line that is wrong is marked and brought into view. */
import { useEffect, useRef } from "preact/hooks";
import { type Fault, lineRange } from "./lines";

interface EditorProps {
  label: string;
  text: string;
  fault: Fault | null;
  readOnly?: boolean;
  onText: (text: string) => void;
}

export function TextEditor({ label, text, fault, readOnly = false, onText }: EditorProps) {
  const area = useRef<HTMLTextAreaElement>(null);
  const numbers = useRef<HTMLPreElement>(null);
  const count = text.split("\n").length;
  const rows = Array.from({ length: count }, (_, index) => index + 1);
  const line = fault?.line ?? null;
  const follow = (): void => {
    if (numbers.current !== null && area.current !== null) numbers.current.scrollTop = area.current.scrollTop;
  };
  useEffect(() => {
    const element = area.current;
    if (fault === null || fault.line === null || element === null) return;
    const [start, end] = lineRange(element.value, fault.line);
    element.focus();
    element.setSelectionRange(start, end);
    const height = element.scrollHeight / Math.max(1, element.value.split("\n").length);
    element.scrollTop = Math.max(0, (fault.line - 4) * height);
    follow();
  }, [fault]);
  return (
    <div class="editor">
      <pre ref={numbers} aria-hidden="true">
        {rows.map((row) => (
          <span key={row} class={row === line ? "wrong" : ""}>
            {row === line ? `✕${row}` : row}
            {"\n"}
          </span>
        ))}
      </pre>
      <textarea
        ref={area}
        aria-label={label}
        aria-invalid={fault !== null}
        wrap="off"
        spellcheck={false}
        autocapitalize="off"
        autocomplete="off"
        readOnly={readOnly}
        value={text}
        onScroll={follow}
        onInput={(event) => onText(event.currentTarget.value)}
      />
    </div>
  );
}
