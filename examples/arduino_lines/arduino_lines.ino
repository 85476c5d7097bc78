// A 4x4 velostat mat on an Arduino Uno, a line "t_us,v1,...,v16" per scan over USB.
// Rows are driven by digital pins, columns are read by analog pins, each with 10 kOhm to ground.
//
//   taxelflow run 'serial:/dev/ttyACM0?baud=115200&time-unit=us' --sensor grid:4x4@10mm --to jsonl:-

const int ROWS[] = {2, 3, 4, 5};
const int COLS[] = {A0, A1, A2, A3};

void setup() {
  Serial.begin(115200);
  for (int row : ROWS) {
    pinMode(row, OUTPUT);
    digitalWrite(row, LOW);
  }
}

void loop() {
  Serial.print(micros());  // as seconds it would lose digits: a double has 24 bits here
  for (int row : ROWS) {
    digitalWrite(row, HIGH);
    delayMicroseconds(50);
    for (int col : COLS) {
      Serial.print(',');
      Serial.print(analogRead(col));
    }
    digitalWrite(row, LOW);
  }
  Serial.print('\n');
}
