// A 16x16 mat on an ESP32 with two 16-channel multiplexers, a binary frame per scan over Wi-Fi.
// The frame is the one that mat.toml beside this file describes.
//
//   taxelflow run tcp-listen://0.0.0.0:5000?keep=1 --sensor examples/esp32_frames/mat.toml --to jsonl:-

#include <WiFi.h>

const char *NETWORK = "your network", *PASSWORD = "your password";
const char *HOST = "192.168.1.10";
const int PORT = 5000;
const int ROW_SELECT[] = {16, 17, 18, 19}, COL_SELECT[] = {21, 22, 23, 25}, READING = 34;
const int HEADER_BYTES = 2, TIME_BYTES = 4, READINGS = 256;

uint8_t frame[HEADER_BYTES + TIME_BYTES + 2 * READINGS + 2];
WiFiClient client;

void select(const int *pins, int channel) {
  for (int bit = 0; bit < 4; bit++) digitalWrite(pins[bit], channel >> bit & 1);
}

uint16_t modbus_crc(const uint8_t *content, int length) {
  uint16_t crc = 0xFFFF;
  for (int k = 0; k < length; k++) {
    crc ^= content[k];
    for (int bit = 0; bit < 8; bit++) crc = crc & 1 ? crc >> 1 ^ 0xA001 : crc >> 1;
  }
  return crc;
}

void setup() {
  for (int pin : ROW_SELECT) pinMode(pin, OUTPUT);
  for (int pin : COL_SELECT) pinMode(pin, OUTPUT);
  WiFi.begin(NETWORK, PASSWORD);
}

void loop() {
  if (!client.connected() && !client.connect(HOST, PORT)) {
    delay(200);
    return;
  }
  frame[0] = 0xAA;
  frame[1] = 0x55;
  uint32_t now = micros();
  memcpy(frame + HEADER_BYTES, &now, TIME_BYTES);
  uint8_t *next = frame + HEADER_BYTES + TIME_BYTES;
  for (int row = 0; row < 16; row++) {
    select(ROW_SELECT, row);
    for (int col = 0; col < 16; col++) {
      select(COL_SELECT, col);
      delayMicroseconds(5);
      uint16_t reading = analogRead(READING);
      memcpy(next, &reading, 2);
      next += 2;
    }
  }
  uint16_t crc = modbus_crc(frame + HEADER_BYTES, TIME_BYTES + 2 * READINGS);
  memcpy(next, &crc, 2);
  client.write(frame, sizeof frame);
}
